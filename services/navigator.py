"""`navigator`: pose estimate, path planning and path following of the robots this process holds."""

from __future__ import annotations

from orograph import keys
from orograph.edge.briefing import Briefing
from orograph.edge.guard import Guard, leave, options
from orograph.edge.participant import take_part
from orograph.edge.settings import Settings
from orograph.nodes.navigator import NavigatorNode
from orograph.stages import StageRecorder


def build(briefing: Briefing, robots: tuple[str, ...]) -> tuple[list[NavigatorNode], dict[str, StageRecorder]]:
    """One navigator per robot held."""
    scenario = briefing.scenario
    return [NavigatorNode(scenario, robot, scenario.seed) for robot in robots], {}


if __name__ == "__main__":
    guard = Guard(keys.NAVIGATOR, options(__doc__).parse_args())
    leave(take_part(keys.NAVIGATOR, Settings.from_environment(), guard, build))
