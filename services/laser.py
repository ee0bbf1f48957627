"""`laser`: one range image per scan of the robots this process holds."""

from __future__ import annotations

from orograph import keys
from orograph.nodes.laser import LaserNode
from orograph.runtime.briefing import Briefing
from orograph.runtime.participant import take_part
from orograph.runtime.settings import Settings
from orograph.runtime.watchdog import Watchdog, leave, options
from orograph.scene.site import Site
from orograph.sensing import View
from orograph.stages import StageRecorder


def build(briefing: Briefing, robots: tuple[str, ...]) -> tuple[list[LaserNode], dict[str, StageRecorder]]:
    """One laser per robot held."""
    scenario = briefing.scenario
    view = View(Site(scenario), len(robots))
    return [LaserNode(view, robot, scenario.seed, scenario.robot_ids) for robot in robots], {}


if __name__ == "__main__":
    watchdog = Watchdog(keys.LASER, options(__doc__).parse_args())
    leave(take_part(keys.LASER, Settings.from_environment(), watchdog, build))
