"""A node that can be killed, hung and started again; and the memory that outlives it."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

import numpy as np
from orograph.messages import Envelope, Frame, Message
from orograph.node import Node, Note, Send
from orograph.protocol.store import Changes, MemoryStore, StoredState, StoreFailed

RESTART_FRAMES = 2
"""After a failed sync."""
Sent = tuple[str, str, Message]
"""(plane, to, message)."""
After = Callable[[Frame, Sequence[Envelope], list[Sent]], None]
"""after(frame, inbox, sent): told of every step, of a fatal one too."""


class Machine:
    """Steps the node that `start` makes; it dies with all it holds, but what it has sent is sent."""

    def __init__(self, name: str, start: Callable[[], Node], after: After, begins: int = 0) -> None:
        self.name, self._start, self._after = name, start, after
        self.node: Node | None = None
        self.lives = 0
        self._starts_at, self.hangs_until = begins, 0
        self._missed: list[Envelope] = []

    def kill(self, frame: int, frames: int) -> None:
        self.node, self._missed = None, []
        self._starts_at = max(self._starts_at, frame + frames)

    def hang(self, frame: int, frames: int) -> None:
        self.hangs_until = frame + frames

    def mend(self) -> None:
        """Nothing keeps it from running any more."""
        self._starts_at = self.hangs_until = 0

    def step(self, frame: Frame, inbox: Sequence[Envelope], send: Send, note: Note) -> None:
        if self.node is not None and frame.index < self.hangs_until:
            self._missed += inbox
            return
        if self.node is None:
            if frame.index < self._starts_at:
                return
            self.node, self.lives = self._start(), self.lives + 1
        inbox, self._missed = [*self._missed, *inbox], []
        sent: list[Sent] = []

        def send_and_tell(plane: str, to: str, message: Message) -> None:
            sent.append((plane, to, message))
            send(plane, to, message)

        try:
            self.node.step(frame, inbox, send_and_tell, note)
        except StoreFailed:
            self.kill(frame.index, RESTART_FRAMES)
        self._after(frame, inbox, sent)

    def telemetry(self) -> Mapping[str, float]:
        return {}

    def artifacts(self) -> Mapping[str, np.ndarray]:
        return {}


class WatchedStore(MemoryStore):
    """Tells of every commit that became durable."""

    def __init__(self, committed: Callable[[], None], held: StoredState | None = None) -> None:
        super().__init__()
        self._committed = committed
        self._held = held or self._held

    def commit(self, changes: Changes) -> None:
        before = self.commits
        try:
            super().commit(changes)
        finally:
            if self.commits > before:
                self._committed()
