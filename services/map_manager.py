"""`map-manager`: the global map, folded from every robot's registers, durable before it is acknowledged."""

from __future__ import annotations

import time

from orograph import keys
from orograph.edge.briefing import Briefing
from orograph.edge.guard import Guard, leave, options
from orograph.edge.participant import take_part
from orograph.edge.settings import Settings
from orograph.edge.store import SqliteStore
from orograph.nodes.fleet import robots_of
from orograph.nodes.map_manager import MapManagerNode
from orograph.stages import StageRecorder


def build(briefing: Briefing, robots: tuple[str, ...]) -> tuple[list[MapManagerNode], dict[str, StageRecorder]]:
    """The manager over the store in the run folder."""
    scenario, stages = briefing.scenario, StageRecorder(time.perf_counter_ns)
    briefing.folder.mkdir(parents=True, exist_ok=True)
    store = SqliteStore(briefing.folder / "map.sqlite", scenario.grid.grid.shape)
    return [MapManagerNode(scenario, robots_of(scenario), store, stages)], {keys.MANAGER: stages}


if __name__ == "__main__":
    guard = Guard(keys.MANAGER, options(__doc__).parse_args())
    leave(take_part(keys.MANAGER, Settings.from_environment(), guard, build))
