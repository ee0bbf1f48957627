"""A worker that only claims; in a module of its own, as the processes of a fork server import it by name."""

from __future__ import annotations

import threading
from typing import Any

from orograph import keys
from orograph.comms.bus import Bus
from orograph.control import Claim, Grant

FOR_EVER = threading.Event()


def ask(bus: Bus, instance: str, service: str = keys.LASER, capacity: int = 1) -> list[str] | None:
    """The robots granted, none for a spare; None where nobody answers (yet)."""
    grant = bus.ask(keys.CLAIM, Claim(service, instance, capacity, ()), Grant, 5.0)
    return None if grant is None else list(grant.robots)


def work(endpoint: str, instance: str, together: Any, told: Any) -> None:
    """What a service does before it builds its nodes: claim, show its token, or wait as a spare; until it is killed."""
    with Bus.open(endpoint, None, FOR_EVER) as bus:
        together.wait(60)
        robots: list[str] | None = None
        while not robots:
            granted = ask(bus, instance)
            if granted is not None and granted != robots:
                robots = granted
                told.put((instance, tuple(granted)))
        token = bus.token(keys.LASER, instance, tuple(robots))
        FOR_EVER.wait()
        token.undeclare()
