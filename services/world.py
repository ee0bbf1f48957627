"""`world`: physics, simulation time, raw sensors, ground truth."""

from __future__ import annotations

from contextlib import suppress

from orograph import keys
from orograph.comms.bus import Bus
from orograph.nodes.world import WorldNode
from orograph.runtime.briefing import Briefing, answer, await_briefing
from orograph.runtime.clock import Clock
from orograph.runtime.host import NodeHost
from orograph.runtime.roster import Roster
from orograph.runtime.settings import Settings
from orograph.runtime.watchdog import Watchdog, leave, options, whole_number
from orograph.storage.recording import Recording
from orograph.storage.results import WorldResult


def main() -> None:
    """Run the service until the orchestrator ends the run."""
    parser = options(__doc__)
    parser.add_argument("--start-with", type=whole_number, metavar="N", help="begin with N whole robots (default: all)")
    arguments = parser.parse_args()
    watchdog, settings = Watchdog(keys.WORLD, arguments), Settings.from_environment()
    with suppress(InterruptedError), Bus.open(settings.sim, None, watchdog.stop) as bus:
        briefing = await_briefing(bus, settings.run_dir, watchdog)
        if briefing is not None:
            answer(bus, briefing)
            _turn(bus, briefing, watchdog, arguments.start_with)


def _turn(bus: Bus, briefing: Briefing, watchdog: Watchdog, start_with: int | None) -> None:
    scenario, robots = briefing.scenario, briefing.scenario.robot_ids
    watchdog.busy()
    node = WorldNode(scenario, robots, scenario.seed)
    node.present = set()
    roster = Roster(robots, start_with or len(robots), node.present)
    with Recording(briefing.folder, keys.WORLD) as recording:
        host = NodeHost(bus, [node], scenario, recording)
        down = lambda: (robot for robot, up in node.radio_up().items() if not up)  # noqa: E731
        clock = Clock(bus, host, scenario, watchdog, ended=lambda: node.ended is not None, down=down, roster=roster)
        clock.await_start()
        clock.run()
        watchdog.busy()
        host.save({})
        recording.save_result(WorldResult.of(node.world.stamp_ns, clock.wall_time_s, node.ended, clock.deterministic))


if __name__ == "__main__":
    main()
    leave()
