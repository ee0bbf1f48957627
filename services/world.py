"""`world`: physics, simulation time, raw sensors, ground truth."""

from __future__ import annotations

from contextlib import suppress

from orograph import keys
from orograph.edge.briefing import Briefing, answer, await_briefing
from orograph.edge.bus import Bus
from orograph.edge.clock import Clock
from orograph.edge.guard import Guard, leave, options, whole_number
from orograph.edge.host import NodeHost
from orograph.edge.recording import Recording
from orograph.edge.settings import Settings
from orograph.nodes.fleet import Muster, robots_of
from orograph.nodes.world import WorldNode


def main() -> None:
    """Run the service until the orchestrator ends the run."""
    parser = options(__doc__)
    parser.add_argument("--start-with", type=whole_number, metavar="N", help="begin with N whole robots (default: all)")
    arguments = parser.parse_args()
    guard, settings = Guard(keys.WORLD, arguments), Settings.from_environment()
    with suppress(InterruptedError), Bus.open(settings.sim, None, guard.stop) as bus:
        briefing = await_briefing(bus, settings.run_dir, guard)
        if briefing is not None:
            answer(bus, briefing)
            _turn(bus, briefing, guard, arguments.start_with)


def _turn(bus: Bus, briefing: Briefing, guard: Guard, start_with: int | None) -> None:
    scenario, robots = briefing.scenario, robots_of(briefing.scenario)
    guard.busy()
    node = WorldNode(scenario, robots, scenario.seed)
    node.present = set()
    muster = Muster(robots, start_with or len(robots), node.present)
    with Recording(briefing.folder, keys.WORLD) as recording:
        host = NodeHost(bus, [node], scenario, recording)
        down = lambda: (robot for robot, up in node.radio_up().items() if not up)  # noqa: E731
        clock = Clock(bus, host, scenario, guard, ended=lambda: node.ended is not None, down=down, muster=muster)
        clock.await_start()
        clock.run()
        guard.busy()
        host.save(keys.WORLD, {})
        recording.save_json("world", {
            "sim_time_s": node.world.stamp_ns * 1e-9, "wall_time_s": clock.wall_time_s,
            "complete": bool(node.ended and node.ended.complete), "deterministic": clock.lost == 0,
            "copies_equal": bool(node.ended and node.ended.copies_equal),
        })  # fmt: skip


if __name__ == "__main__":
    main()
    leave()
