"""What a process has received and not yet stepped with; in lockstep nobody steps before it holds what was counted."""

from __future__ import annotations

import threading
import time
from collections import Counter, defaultdict, deque
from collections.abc import Collection, Iterable, Mapping
from typing import Any

from orograph import keys
from orograph.comms import wire
from orograph.fields import bytes_max
from orograph.kinds import Rejected
from orograph.messages import Envelope
from orograph.routes import check_route

Stream = tuple[str, str, str]
"""(plane, to address, sender)."""
PATIENCE_S = 2.0
"""Longest wait for a counted message: the link's lease. It was lost if it takes longer."""
CUT_PATIENCE_S = 0.05
"""Wait per frame on a plane that has just been seen to lose messages, until it is whole again."""
BOUND, BOUND_BYTES = 8_192, 256 * 2**20
"""What waits is at most so many messages of so many bytes together; beyond that the oldest go."""
AHEAD_FRAMES_MAX = 100
"""Senders are ahead of this process by no more than a tick's journey; what says otherwise would wait for ever."""


class Mailbox:
    """Bounded store of received envelopes; filled by Zenoh's callback threads, emptied by the stepping thread."""

    def __init__(self, robots: Collection[str], bound: int = BOUND, bound_bytes: int = BOUND_BYTES) -> None:
        """`robots` are those of the run: no other may send."""
        self._robots = frozenset(robots)
        self._bound, self._bound_bytes = bound, bound_bytes
        self._changed = threading.Condition()
        self._joiner = wire.Joiner()
        self._waiting: deque[tuple[Envelope, int]] = deque()
        self._waiting_bytes = 0
        self._arrived: Counter[tuple[int, Stream]] = Counter()
        self._cut: set[str] = set()
        self.lost = 0
        """Messages to these nodes that none of them will see: given up, overflowed, astray, or unreadable."""
        self.counts: defaultdict[str, int] = defaultdict(int)
        self.bytes_received: Counter[tuple[str, str, str]] = Counter()

    @property
    def waiting(self) -> int:
        """Messages received and not yet taken."""
        return len(self._waiting)

    def add(self, key: str, piece: bytes) -> None:
        """Take one fragment off the wire; bad ones are counted by reason and change nothing."""
        with self._changed:
            try:
                self._add(key, piece)
            except (Rejected, ValueError) as error:
                self.counts[f"rejected_{getattr(error, 'reason', 'key')}"] += 1
            self._changed.notify_all()

    def _add(self, key: str, piece: bytes) -> None:
        plane, to, name, sender = keys.parse_message_key(key)
        kind = wire.kind_of(name)
        check_route(kind, plane, sender, to, self._robots)
        self.bytes_received[plane, to, sender] += len(piece)
        whole = self._joiner.add(key, piece, bytes_max(kind))
        self.counts["forgotten"] = self._joiner.forgotten
        if whole is None:
            return
        frame, index, payload = whole
        self._arrived[frame, (plane, to, sender)] += 1
        if len(self._arrived) > self._bound:
            del self._arrived[next(iter(self._arrived))]
        try:
            message = wire.decode(kind, payload)
        except Rejected:
            self.lost += 1
            raise
        self._waiting.append((Envelope(plane, to, sender, frame, index, message), len(payload)))
        self._waiting_bytes += len(payload)
        while len(self._waiting) > self._bound or self._waiting_bytes > self._bound_bytes:
            self._waiting_bytes -= self._waiting.popleft()[1]
            self.lost += 1
            self.counts["overflowed"] += 1

    def await_counted(self, frame: int, need: Mapping[Stream, int], stop: threading.Event) -> int:
        """Wait until all messages counted for `frame` are here; returns how many were given up as lost."""
        missing = 0
        for plane in keys.PLANES:
            wanted = {route: n for route, n in need.items() if route[0] == plane and n}
            if wanted:
                missing += self._await_plane(plane, frame, wanted, stop)
        self.counts["lost"] += missing
        self.lost += missing
        return missing

    def _await_plane(self, plane: str, frame: int, wanted: Mapping[Stream, int], stop: threading.Event) -> int:
        deadline = time.monotonic() + (CUT_PATIENCE_S if plane in self._cut else PATIENCE_S)
        with self._changed:
            while (missing := self._missing(frame, wanted)) and not stop.is_set():
                left = deadline - time.monotonic()
                if left <= 0:
                    self._cut.add(plane)
                    return missing
                self._changed.wait(min(left, 0.5))
            self._cut.discard(plane)
            return 0

    def _missing(self, frame: int, wanted: Mapping[Stream, int]) -> int:
        return sum(max(0, n - self._arrived[frame, route]) for route, n in wanted.items())

    def take(self, before: int, newest_only: bool) -> list[Envelope]:
        """Remove and return what was sent in frames before `before`, ordered by (frame, sender, index)."""
        soon = range(before, before + AHEAD_FRAMES_MAX)
        with self._changed:
            ready = [e for e, _ in self._waiting if e.frame < before]
            kept = deque((e, size) for e, size in self._waiting if e.frame in soon)
            astray = len(self._waiting) - len(ready) - len(kept)
            self.counts["rejected_frame"] += astray
            self.lost += astray
            self._waiting, self._waiting_bytes = kept, sum(size for _, size in kept)
            for counted in [c for c in self._arrived if c[0] not in soon]:
                del self._arrived[counted]
        ready.sort(key=lambda e: (e.frame, e.sender, e.index))
        return self._thin(ready) if newest_only else ready

    def _thin(self, ready: list[Envelope]) -> list[Envelope]:
        newest = {stream: e for e in ready if (stream := _stream(e)) is not None}
        kept = [e for e in ready if (stream := _stream(e)) is None or newest[stream] is e]
        self.counts["skipped"] += len(ready) - len(kept)
        return kept


def _stream(e: Envelope) -> tuple[Any, ...] | None:
    """What tells apart the streams of which the newest message replaces the others; None where each one counts."""
    by = e.message.newest_by
    return None if by is None else (e.plane, e.to, e.sender, type(e.message), *(getattr(e.message, f) for f in by))


def streams_to(nodes: Iterable[str], counted: Mapping[str, int]) -> dict[Stream, int]:
    """From a tick's counts by stream, what these nodes must hold before they step."""
    names = list(nodes)
    addresses = {*names, *(keys.group(keys.split(n)[0]) for n in names if keys.split(n)[1])}
    streams = {keys.parse_stream_name(name): n for name, n in counted.items()}
    return {stream: n for stream, n in streams.items() if stream[1] in addresses}
