"""`world`: physics, simulation time, raw sensors, ground truth."""

from __future__ import annotations

import sys

from orograph import keys
from orograph.edge.bus import Bus
from orograph.edge.clock import Clock
from orograph.edge.guard import Guard
from orograph.edge.host import NodeHost
from orograph.edge.recording import Recording
from orograph.edge.settings import Settings
from orograph.nodes.fleet import required_nodes, robots_of
from orograph.nodes.world import WorldNode


def main() -> None:
    """Run the service until the orchestrator ends the run."""
    guard = Guard(keys.WORLD, "--with-parent" in sys.argv)
    settings = Settings.from_environment()
    scenario = settings.scenario()
    robots = robots_of(scenario)
    node = WorldNode(scenario, robots, scenario.seed)
    with Recording(settings.run_dir, keys.WORLD) as recording, Bus.open(settings.sim, None, guard.stop) as bus:
        host = NodeHost(bus, [node], scenario, recording)
        down = lambda: (robot for robot, up in node.radio_up().items() if not up)  # noqa: E731
        clock = Clock(bus, host, scenario, guard, ended=lambda: node.ended is not None, down=down)
        clock.await_start(required_nodes(robots))
        clock.run()
        host.save(keys.WORLD, {})
        recording.save_json("world", {
            "sim_time_s": node.world.stamp_ns * 1e-9, "wall_time_s": clock.wall_time_s,
            "complete": bool(node.ended and node.ended.complete), "deterministic": clock.lost == 0,
            "copies_equal": bool(node.ended and node.ended.copies_equal),
        })  # fmt: skip


if __name__ == "__main__":
    main()
