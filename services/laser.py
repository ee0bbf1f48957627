"""`laser`: one range image per scan of the robots this process holds."""

from __future__ import annotations

import sys

from orograph import keys
from orograph.edge.guard import Guard
from orograph.edge.participant import take_part
from orograph.edge.settings import Settings
from orograph.nodes.fleet import robots_of
from orograph.nodes.laser import LaserNode
from orograph.scenario import Scenario
from orograph.stages import StageRecorder


def build(scenario: Scenario, robots: tuple[str, ...]) -> tuple[list[LaserNode], dict[str, StageRecorder]]:
    """One laser per robot held."""
    return [LaserNode(scenario, robot, scenario.seed, robots_of(scenario)) for robot in robots], {}


if __name__ == "__main__":
    take_part(keys.LASER, Settings.from_environment(), Guard(keys.LASER, "--with-parent" in sys.argv), build)
