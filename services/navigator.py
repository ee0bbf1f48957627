"""`navigator`: pose estimate, path planning and path following of the robots this process holds."""

from __future__ import annotations

import sys

from orograph import keys
from orograph.edge.guard import Guard
from orograph.edge.participant import take_part
from orograph.edge.settings import Settings
from orograph.nodes.navigator import NavigatorNode
from orograph.scenario import Scenario
from orograph.stages import StageRecorder


def build(scenario: Scenario, robots: tuple[str, ...]) -> tuple[list[NavigatorNode], dict[str, StageRecorder]]:
    """One navigator per robot held."""
    return [NavigatorNode(scenario, robot, scenario.seed) for robot in robots], {}


if __name__ == "__main__":
    take_part(keys.NAVIGATOR, Settings.from_environment(), Guard(keys.NAVIGATOR, "--with-parent" in sys.argv), build)
