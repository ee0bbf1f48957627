"""`orchestrator`: who holds which robot, who drives where, when the run ends."""

from __future__ import annotations

import sys

from orograph import keys
from orograph.edge.claims import Claims
from orograph.edge.guard import Guard
from orograph.edge.participant import take_part
from orograph.edge.settings import Settings
from orograph.nodes.fleet import robots_of
from orograph.nodes.orchestrator import OrchestratorNode
from orograph.scenario import Scenario
from orograph.stages import StageRecorder


def main() -> None:
    """Run the service."""
    guard = Guard(keys.ORCHESTRATOR, "--with-parent" in sys.argv)
    settings = Settings.from_environment()
    scenario = settings.scenario()
    node = OrchestratorNode(scenario, robots_of(scenario), scenario.seed)
    claims = Claims(robots_of(scenario), on_fleet=node.present)

    def build(scenario: Scenario, robots: tuple[str, ...]) -> tuple[list[OrchestratorNode], dict[str, StageRecorder]]:
        return [node], {}

    take_part(keys.ORCHESTRATOR, settings, guard, build, attend=claims.attend)


if __name__ == "__main__":
    main()
