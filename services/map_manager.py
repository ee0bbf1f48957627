"""`map-manager`: the global map, folded from every robot's registers, durable before it is acknowledged."""

from __future__ import annotations

import logging
import secrets
import time

from orograph import keys
from orograph.nodes.map_manager import MapManagerNode
from orograph.protocol.store import StoreError
from orograph.runtime import metrics
from orograph.runtime.briefing import Briefing
from orograph.runtime.participant import take_part
from orograph.runtime.settings import Settings
from orograph.runtime.watchdog import EXIT_BROKEN, Watchdog, leave, options
from orograph.scene.site import Site
from orograph.stages import StageRecorder
from orograph.storage.run_folder import STORE
from orograph.storage.sqlite_store import SqliteStore


def build(briefing: Briefing, robots: tuple[str, ...]) -> tuple[list[MapManagerNode], dict[str, StageRecorder]]:
    """The manager over the store in the run folder."""
    scenario, stages = briefing.scenario, StageRecorder(time.perf_counter_ns)
    briefing.folder.mkdir(parents=True, exist_ok=True)
    store = SqliteStore(briefing.folder / STORE, scenario.grid.grid.shape, metrics.COMMIT.time)
    node = MapManagerNode(Site(scenario), scenario.robot_ids, store, stages, draw=secrets.randbits(31))
    return [node], {keys.MANAGER: stages}


if __name__ == "__main__":
    watchdog = Watchdog(keys.MANAGER, options(__doc__).parse_args())
    try:
        code = take_part(keys.MANAGER, Settings.from_environment(), watchdog, build)
    except StoreError as error:
        logging.getLogger("orograph").critical("%s", error)
        code = EXIT_BROKEN
    leave(code)
