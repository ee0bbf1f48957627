"""`laser`: one range image per scan of the robots this process holds."""

from __future__ import annotations

from orograph import keys
from orograph.edge.briefing import Briefing
from orograph.edge.guard import Guard, leave, options
from orograph.edge.participant import take_part
from orograph.edge.settings import Settings
from orograph.nodes.fleet import robots_of
from orograph.nodes.laser import LaserNode
from orograph.stages import StageRecorder


def build(briefing: Briefing, robots: tuple[str, ...]) -> tuple[list[LaserNode], dict[str, StageRecorder]]:
    """One laser per robot held."""
    scenario = briefing.scenario
    return [LaserNode(scenario, robot, scenario.seed, robots_of(scenario)) for robot in robots], {}


if __name__ == "__main__":
    guard = Guard(keys.LASER, options(__doc__).parse_args())
    leave(take_part(keys.LASER, Settings.from_environment(), guard, build))
