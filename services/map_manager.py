"""`map-manager`: the global map, folded from every robot's registers, durable before it is acknowledged."""

from __future__ import annotations

import logging
import secrets
import time

from orograph import keys
from orograph.comms.bus import Bus
from orograph.control import Revoke, Revoked
from orograph.kinds import Rejected
from orograph.nodes.map_manager import MapManagerNode
from orograph.protocol.store import StoreError
from orograph.runtime import metrics
from orograph.runtime.briefing import Briefing, await_briefing
from orograph.runtime.participant import take_part
from orograph.runtime.settings import Settings
from orograph.runtime.watchdog import EXIT_BROKEN, Watchdog, leave, options
from orograph.scene.site import Site
from orograph.stages import StageRecorder
from orograph.storage.run_folder import STORE
from orograph.storage.sqlite_store import SqliteStore


def build(briefing: Briefing) -> tuple[MapManagerNode, StageRecorder]:
    """The manager over the store in the run folder."""
    scenario, stages = briefing.scenario, StageRecorder(time.perf_counter_ns)
    briefing.folder.mkdir(parents=True, exist_ok=True)
    store = SqliteStore(briefing.folder / STORE, scenario.grid.grid.shape, metrics.COMMIT.time)
    node = MapManagerNode(Site(scenario), scenario.robot_ids, store, stages, draw=secrets.randbits(31))
    return node, stages


def run(watchdog: Watchdog) -> int:
    """Take part, and do what people ask of the manager; raises StoreError."""
    nodes: list[MapManagerNode] = []

    def take(asked: Revoke) -> Revoked:
        if not nodes:
            raise Rejected("starting", "the map is being loaded")
        return nodes[0].take_revoke(asked)

    def brief(bus: Bus) -> Briefing | None:
        bus.answer_each(keys.REVOKE, Revoke, take, keys.RADIO)
        return await_briefing(bus, settings.run_dir, watchdog)

    def built(briefing: Briefing, robots: tuple[str, ...]) -> tuple[list[MapManagerNode], dict[str, StageRecorder]]:
        node, stages = build(briefing)
        nodes.append(node)
        return nodes, {keys.MANAGER: stages}

    settings = Settings.from_environment()
    return take_part(keys.MANAGER, settings, watchdog, built, brief)


if __name__ == "__main__":
    watchdog = Watchdog(keys.MANAGER, options(__doc__).parse_args())
    try:
        code = run(watchdog)
    except StoreError as error:
        logging.getLogger("orograph").critical("%s", error)
        code = EXIT_BROKEN
    leave(code)
