"""When to send again: jittered, slower while nobody answers (protocol.md, "Up")."""

from __future__ import annotations

from orograph.randomness import stream

FASTEST_NS = 500_000_000
SLOWEST_NS = 4_000_000_000


class Backoff:
    """Due times 0.5 s apart, doubling to 4 s while unanswered, each shifted by a seeded jitter of -20 % to +20 %."""

    def __init__(self, seed: int, *names: str) -> None:
        self._seed, self._names = seed, names
        self._interval_ns = FASTEST_NS
        self._due_ns = self._sent_ns = 0

    def due(self, now_ns: int) -> bool:
        """Whether it is time to send."""
        return now_ns >= self._due_ns

    @property
    def backed_off(self) -> bool:
        """Whether the last attempts stayed unanswered."""
        return self._interval_ns > FASTEST_NS

    def sent(self, now_ns: int) -> None:
        """Something went out: the next is due one interval from now."""
        jitter = stream(self._seed, *self._names, frame=now_ns // 1_000_000).integers(80, 121)
        self._sent_ns, self._due_ns = now_ns, now_ns + self._interval_ns * int(jitter) // 100

    def unanswered(self) -> None:
        """Nobody answered in time: slow down."""
        self._interval_ns = min(2 * self._interval_ns, SLOWEST_NS)

    def answered(self) -> None:
        """The other side is there: full speed, and no waiting for the end of a long pause."""
        if self.backed_off:
            self._due_ns = min(self._due_ns, self._sent_ns + FASTEST_NS)
        self._interval_ns = FASTEST_NS

    def hurry(self, now_ns: int) -> None:
        """The link is back: full speed, and due within one interval, jittered."""
        self.answered()
        share = stream(self._seed, *self._names, "hurry", frame=now_ns // 1_000_000).integers(0, 81)
        self._due_ns = min(self._due_ns, now_ns + FASTEST_NS * int(share) // 100)
