"""A worker process that only claims; in a module of its own, as the processes of a fork server import it by name."""

from __future__ import annotations

import threading
from typing import Any

from orograph import keys
from orograph.edge import wire
from orograph.edge.bus import Bus

FOR_EVER = threading.Event()


def work(endpoint: str, instance: str, together: Any, told: Any) -> None:
    """What a service does before it builds its nodes: claim, show its token, or wait as a spare; until it is killed."""
    question = wire.pack_plain({"service": keys.LASER, "instance": instance, "capacity": 1, "wanted": []})
    with Bus.open(endpoint, None, FOR_EVER) as bus:
        together.wait(60)
        robots: list[str] | None = None
        while not robots:
            reply = bus.ask(keys.CLAIM, question, 10.0)
            if reply is not None and (granted := wire.unpack_plain(reply)["robots"]) != robots:
                robots = granted
                told.put((instance, tuple(granted)))
        token = bus.token(keys.LASER, instance, tuple(robots))
        FOR_EVER.wait()
        token.undeclare()
