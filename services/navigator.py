"""`navigator`: pose estimate, path planning and path following of the robots this process holds."""

from __future__ import annotations

from orograph import keys
from orograph.nodes.navigator import NavigatorNode
from orograph.runtime.briefing import Briefing
from orograph.runtime.participant import take_part
from orograph.runtime.settings import Settings
from orograph.runtime.watchdog import Watchdog, leave, options
from orograph.scene.site import Site
from orograph.stages import StageRecorder


def build(briefing: Briefing, robots: tuple[str, ...]) -> tuple[list[NavigatorNode], dict[str, StageRecorder]]:
    """One navigator per robot held."""
    site = Site(briefing.scenario)
    return [NavigatorNode(site, robot, site.scenario.seed) for robot in robots], {}


if __name__ == "__main__":
    watchdog = Watchdog(keys.NAVIGATOR, options(__doc__).parse_args())
    leave(take_part(keys.NAVIGATOR, Settings.from_environment(), watchdog, build))
