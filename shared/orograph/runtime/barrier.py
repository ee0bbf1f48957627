"""The world's side of lockstep: who takes part, the tick, the wait for every answer (architecture.md, "Time")."""

from __future__ import annotations

import threading
import time
from collections.abc import Iterable
from typing import Any

from orograph import keys
from orograph.comms import wire
from orograph.comms.bus import Bus

Table = dict[str, dict[str, dict[str, int]]]
RESEND_S = 1.0
"""A tick or an answer can be lost when the sim plane's link breaks: the tick is repeated until it is answered."""


class Barrier:
    """Participants join by an answer to no tick (frame -1), are in while their liveliness token is there."""

    def __init__(self, bus: Bus) -> None:
        self._bus = bus
        self._changed = threading.Condition()
        self._joined: dict[str, frozenset[str]] = {}
        self._alive: set[str] = set()
        self._answers: dict[str, dict[str, Any]] = {}
        self._first_roster: list[str] | None = None
        self.lost = 0
        self.steady = True
        """Nobody has left or come since the first tick; who comes back is somebody new."""
        bus.watch_alive(self._on_token)
        bus.hear(f"{keys.DONE}/*", self._on_answer)

    def _on_token(self, service: str, instance: str, robots: tuple[str, ...], alive: bool) -> None:
        with self._changed:
            (self._alive.add if alive else self._alive.discard)(instance)
            if not alive and self._joined.pop(instance, None) is not None:
                self.steady = self.steady and self._first_roster is None
            self._changed.notify_all()

    def _on_answer(self, payload: bytes) -> None:
        answer = wire.unpack_plain(payload)
        with self._changed:
            self._joined[answer["instance"]] = frozenset(answer["nodes"])
            self._answers[answer["instance"]] = answer
            self._changed.notify_all()

    @property
    def nodes(self) -> set[str]:
        """Nodes that take part now."""
        with self._changed:
            return {n for i, nodes in self._joined.items() if i in self._alive for n in nodes}

    def await_nodes(self, required: Iterable[str], stop: threading.Event, timeout_s: float = 0.2) -> set[str]:
        """Wait a little for nodes that are to take part; returns those still missing."""
        with self._changed:
            self._changed.wait_for(lambda: stop.is_set() or not self._missing(required), timeout_s)
            return self._missing(required)

    def _missing(self, required: Iterable[str]) -> set[str]:
        return set(required) - {n for i, nodes in self._joined.items() if i in self._alive for n in nodes}

    def tick(self, frame: int, tick: dict[str, Any]) -> list[str]:
        """Publish a frame's tick to all who take part; returns them."""
        with self._changed:
            roster = sorted(i for i in self._joined if i in self._alive)
            self._first_roster = roster if self._first_roster is None else self._first_roster
            self.steady = self.steady and roster == self._first_roster
        self._payload = wire.pack_plain({**tick, "frame": frame, "roster": roster})
        self._bus.tell(keys.TICK, self._payload)
        return roster

    def await_answers(self, frame: int, roster: list[str], stop: threading.Event) -> Table:
        """Wait until everybody alive has answered this frame; returns what was sent to whom, all senders together."""
        resend_s = time.monotonic() + RESEND_S
        with self._changed:
            while self._pending(frame, roster) and not stop.is_set():
                self._changed.wait(RESEND_S)
                if time.monotonic() > resend_s:
                    resend_s = time.monotonic() + RESEND_S
                    self._bus.tell(keys.TICK, self._payload)
            table: Table = {}
            for instance in roster:
                answer = self._answers.get(instance, {})
                if answer.get("frame") == frame:
                    merge(table, answer["sent"])
                    self.lost += answer["lost"]
            return table

    def _pending(self, frame: int, roster: list[str]) -> bool:
        there = [i for i in roster if i in self._alive and i in self._joined]
        return any(self._answers[i]["frame"] < frame for i in there)


def merge(table: Table, more: Table) -> None:
    """Add one participant's counts to the frame's table, in place."""
    for plane, receivers in more.items():
        for to, senders in receivers.items():
            table.setdefault(plane, {}).setdefault(to, {}).update(senders)
