"""What a node is: one step object per service (and robot), messages in, messages out."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any, Protocol

import numpy.typing as npt

from orograph.messages import Envelope, Frame, Message

Send = Callable[[str, str, Message], None]
"""send(plane, to, message): `to` is a node name or a group address from `keys`."""
Note = Callable[[str, Mapping[str, Any]], None]
"""note(kind, fields): one line for events.jsonl; the shell adds stamp_ns, service and robot."""


class Every:
    """A beat: due in the first frame, then in the first frame of every full period, whichever frame that is."""

    def __init__(self, period_ns: int) -> None:
        self._period_ns, self._due_ns = period_ns, 0

    def due(self, now_ns: int) -> bool:
        """Whether it is; asked once a frame, True once a period."""
        if now_ns < self._due_ns:
            return False
        self._due_ns = now_ns - now_ns % self._period_ns + self._period_ns
        return True


class Node(Protocol):
    """A service's step object, for one robot where the service is per robot."""

    name: str

    def step(self, frame: Frame, inbox: Sequence[Envelope], send: Send, note: Note) -> None:
        """Take what was sent in the frame before, ordered by (sender, index); send what follows from it."""

    def telemetry(self) -> Mapping[str, float]:
        """Figures for people (metrics, progress view): name with unit -> value."""

    def artifacts(self) -> Mapping[str, npt.NDArray[Any]]:
        """What the run folder keeps of this node at the end, as named arrays (numpy scalars allowed)."""
