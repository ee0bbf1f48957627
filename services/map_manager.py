"""`map-manager`: the global map, folded from every robot's registers, durable before it is acknowledged."""

from __future__ import annotations

import sys
import time

from orograph import keys
from orograph.edge.guard import Guard
from orograph.edge.participant import take_part
from orograph.edge.settings import Settings
from orograph.edge.store import SqliteStore
from orograph.nodes.fleet import robots_of
from orograph.nodes.map_manager import MapManagerNode
from orograph.scenario import Scenario
from orograph.stages import StageRecorder


def main() -> None:
    """Run the service over the store in the run folder."""
    guard = Guard(keys.MANAGER, "--with-parent" in sys.argv)
    settings = Settings.from_environment()

    def build(scenario: Scenario, robots: tuple[str, ...]) -> tuple[list[MapManagerNode], dict[str, StageRecorder]]:
        stages = StageRecorder(time.perf_counter_ns)
        store = SqliteStore(settings.run_dir / "map.sqlite", scenario.grid.grid.shape)
        return [MapManagerNode(scenario, robots_of(scenario), store, stages)], {keys.MANAGER: stages}

    take_part(keys.MANAGER, settings, guard, build)


if __name__ == "__main__":
    main()
