"""Zenoh routers, one per plane, and their clients, with the settings that measurements ask for."""

from __future__ import annotations

import json
import logging
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import zenoh

LEASE_MS = 2_000
"""A link that is silent this long is gone; a cable pull is seen within it."""

log = logging.getLogger("orograph.session")


def _config(settings: dict[str, Any]) -> zenoh.Config:
    config = zenoh.Config()
    common = {
        "scouting/multicast/enabled": False,
        "scouting/gossip/enabled": False,
        "transport/link/tx/lease": LEASE_MS,
        "transport/shared_memory/enabled": False,
        # A droppable message may wait this long for room: with zenoh's 1 ms and two batches a starved machine drops
        # messages of a healthy link; more would let one stuck receiver hold up the others.
        "transport/link/tx/queue/congestion_control/drop/wait_before_drop": 100_000,
        "transport/link/tx/queue/size/data": 16,
        "connect/retry": {"period_init_ms": 200, "period_max_ms": 1000, "period_increase_factor": 2},
    }
    for key, value in {**common, **settings}.items():
        config.insert_json5(key, json.dumps(value))
    return config


def router_config(endpoint: str, peers: tuple[str, ...] = ()) -> zenoh.Config:
    """A router that listens on one endpoint and links to other hosts' routers, which may come later."""
    block = "transport/link/tx/queue/congestion_control/block/wait_before_close"
    links: dict[str, Any] = {}
    if peers:
        links = {"connect/endpoints": list(peers), "connect/timeout_ms": -1, "connect/exit_on_failure": False}
    return _config({"mode": "router", "listen/endpoints": [endpoint], block: 500_000, **links})


def open_router(endpoint: str, peers: tuple[str, ...] = ()) -> zenoh.Session:
    """Open a router; raises OSError where the endpoint can't be listened on."""
    try:
        return zenoh.open(router_config(endpoint, peers))
    except zenoh.ZError as error:
        raise OSError(f"cannot listen on {endpoint}: {error}") from error


@contextmanager
def client(endpoint: str, stop: threading.Event) -> Iterator[zenoh.Session]:
    """A session of the router at `endpoint`; waits for it, saying so once; raises InterruptedError on `stop`."""
    config = _config({"mode": "client", "connect/endpoints": [endpoint], "connect/timeout_ms": 3_000})
    session, said = None, False
    while session is None:
        try:
            session = zenoh.open(config)
        except zenoh.ZError:
            if not said:
                log.warning("waiting for the router at %s", endpoint)
            said = True
            if stop.wait(0.2):
                raise InterruptedError(f"stopped while waiting for the router at {endpoint}") from None
    with session:
        yield session
