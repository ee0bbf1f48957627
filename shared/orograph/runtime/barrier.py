"""The world's side of lockstep: who takes part, the tick, the wait for every answer (architecture.md, "Time")."""

from __future__ import annotations

import threading
import time
from collections.abc import Iterable, Mapping

from orograph import keys
from orograph.comms.bus import Bus
from orograph.control import INSTANCES_MAX, Answer, Tick
from orograph.kinds import Rejected

EMPTY: Mapping[str, int] = {}
RESEND_S = 1.0
"""A tick or an answer can be lost when the sim plane's link breaks: the tick is repeated until it is answered."""


class Barrier:
    """Participants join by an answer to no tick (frame -1), are in while their liveliness token is there."""

    def __init__(self, bus: Bus) -> None:
        self._bus = bus
        self._changed = threading.Condition()
        self._joined: dict[str, frozenset[str]] = {}
        self._alive: set[str] = set()
        self._answers: dict[str, Answer] = {}
        self._first_roster: list[str] | None = None
        self.lost = 0
        self.steady = True
        """Nobody has left or come since the first tick; who comes back is somebody new."""
        bus.watch_alive(self._on_token)
        bus.hear(Answer.key, Answer, self._on_answer)

    def _on_token(self, service: str, instance: str, robots: tuple[str, ...], alive: bool) -> None:
        with self._changed:
            (self._alive.add if alive else self._alive.discard)(instance)
            if not alive and self._joined.pop(instance, None) is not None:
                self.steady = self.steady and self._first_roster is None
            self._changed.notify_all()

    def _on_answer(self, answer: Answer) -> None:
        with self._changed:
            if answer.instance not in self._joined and len(self._joined) >= INSTANCES_MAX:
                raise Rejected("full", answer.instance)
            self._joined[answer.instance] = frozenset(answer.nodes)
            self._answers[answer.instance] = answer
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

    def tick(
        self, frame: int, counted: Mapping[str, int] = EMPTY, down: Iterable[str] = (), lockstep: bool = False,
        end: bool = False,
    ) -> list[str]:  # fmt: skip
        """Publish a frame's tick to all who take part; returns them."""
        with self._changed:
            roster = sorted(i for i in self._joined if i in self._alive)
            self._first_roster = roster if self._first_roster is None else self._first_roster
            self.steady = self.steady and roster == self._first_roster
        self._tick = Tick(frame, lockstep, end, dict(counted), tuple(sorted(down)), tuple(roster))
        self._bus.tell(keys.TICK, self._tick)
        return roster

    def await_answers(self, frame: int, roster: list[str], stop: threading.Event) -> dict[str, int]:
        """Wait until everybody alive has answered this frame; returns what was sent by stream, all senders together."""
        resend_s = time.monotonic() + RESEND_S
        with self._changed:
            while self._pending(frame, roster) and not stop.is_set():
                self._changed.wait(RESEND_S)
                if time.monotonic() > resend_s:
                    resend_s = time.monotonic() + RESEND_S
                    self._bus.tell(keys.TICK, self._tick)
            sent: dict[str, int] = {}
            for answer in filter(None, map(self._answers.get, roster)):
                if answer.frame == frame:
                    sent |= answer.sent
                    self.lost += answer.lost
            return sent

    def _pending(self, frame: int, roster: list[str]) -> bool:
        there = [i for i in roster if i in self._alive and i in self._joined]
        return any(self._answers[i].frame < frame for i in there)
