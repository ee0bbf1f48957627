"""A read-only ear on the planes: hears kinds of messages along their routes, sends nothing, answers nothing."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass

import zenoh

from orograph import keys
from orograph.comms import wire
from orograph.comms.callbacks import Callbacks
from orograph.control import Figures
from orograph.fields import bytes_max
from orograph.kinds import Rejected
from orograph.messages import Message
from orograph.routes import PEOPLE


@dataclass(frozen=True, eq=False)
class Heard:
    """A message between nodes, or a node's figures (to `people`, of no frame)."""

    sender: str
    to: str
    frame: int
    message: Message | Figures


class Observer:
    """Tells `heard` of every message of these kinds, by plane's session; it is called from Zenoh's threads.

    What came along no route or cannot be read is counted and told as little as the nodes are.
    """

    def __init__(
        self, sessions: Mapping[str, zenoh.Session], kinds: Iterable[type[Message | Figures]],
        heard: Callable[[Heard], None],
    ) -> None:  # fmt: skip
        self.callbacks = Callbacks()
        self._joiner, self._lock = wire.Joiner(), threading.Lock()
        self._heard = heard
        for kind in kinds:
            take = self._take_figures if issubclass(kind, Figures) else self._take_piece
            for plane, key in expressions(kind):
                sessions[plane].declare_subscriber(key, self.callbacks.guarded(keys.callback_kind(key), take))

    def _take_figures(self, sample: zenoh.Sample) -> None:
        node = keys.parse_telemetry_key(str(sample.key_expr))
        self._heard(Heard(node, PEOPLE, -1, wire.decode(Figures, sample.payload.to_bytes())))

    def _take_piece(self, sample: zenoh.Sample) -> None:
        key = str(sample.key_expr)
        plane, to, name, sender = keys.parse_message_key(key)
        kind = wire.kind_of(name)
        if not any(route.carries(plane, sender, to) for route in kind.routes):
            raise Rejected("route", key)
        with self._lock:
            whole = self._joiner.add(key, sample.payload.to_bytes(), bytes_max(kind))
        if whole is not None:
            self._heard(Heard(sender, to, whole[0], wire.decode(kind, whole[2])))


def expressions(kind: type[Message | Figures]) -> list[tuple[str, str]]:
    """(plane, key expression) of all that may carry a kind."""
    if issubclass(kind, Figures):
        return [(keys.SIM, kind.key)]
    services = {(route.plane, keys.split(route.to)[0], route.sender) for route in kind.routes}
    return [(plane, f"{keys.ROOT}/{plane}/{to}/*/{kind.__name__}/{sender}/*") for plane, to, sender in sorted(services)]
