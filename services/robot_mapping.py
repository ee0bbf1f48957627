"""`robot-mapping`: scans into the robot's maps, and what is worth it to the Map Manager."""

from __future__ import annotations

import time
import uuid

from orograph import keys
from orograph.nodes.robot_mapping import RobotMappingNode
from orograph.runtime.briefing import Briefing
from orograph.runtime.participant import take_part
from orograph.runtime.settings import Settings
from orograph.runtime.watchdog import Watchdog, leave, options
from orograph.scene.site import Site
from orograph.stages import StageRecorder


def build(briefing: Briefing, robots: tuple[str, ...]) -> tuple[list[RobotMappingNode], dict[str, StageRecorder]]:
    """One mapper per robot held, with a stage recorder each."""
    stages = {keys.node(keys.MAPPING, robot): StageRecorder(time.perf_counter_ns) for robot in robots}
    site = Site(briefing.scenario)
    nodes = [
        RobotMappingNode(site, robot, site.scenario.seed, uuid.uuid4().bytes, stages[keys.node(keys.MAPPING, robot)])
        for robot in robots
    ]
    return nodes, stages


if __name__ == "__main__":
    watchdog = Watchdog(keys.MAPPING, options(__doc__).parse_args())
    leave(take_part(keys.MAPPING, Settings.from_environment(), watchdog, build))
