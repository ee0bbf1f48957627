"""The manager's side of epochs: one per hello's nonce, durable, the same nonce the same epoch (protocol.md, "Up")."""

from __future__ import annotations

from collections.abc import Iterable

from orograph.protocol.store import Granted

NONCES_KEPT = 64
"""Per robot; a hello older than so many restarts would be taken for a new one."""


class Epochs:
    """Which epochs were granted; raises nothing, grants nothing by itself: the caller commits first."""

    def __init__(self, granted: Iterable[Granted] = ()) -> None:
        self._by_nonce: dict[int, dict[bytes, int]] = {}
        for grant in granted:
            self.add(grant)

    def add(self, grant: Granted) -> None:
        """A grant that has been committed."""
        known = self._by_nonce.setdefault(grant.robot, {})
        known[grant.nonce] = grant.epoch
        if len(known) > NONCES_KEPT:
            del known[next(iter(known))]

    def current(self, robot: int) -> int:
        """The epoch in which the robot may write; 0 before its first hello."""
        return max(self._by_nonce.get(robot, {}).values(), default=0)

    def of(self, robot: int, nonce: bytes) -> int | None:
        """The epoch that this nonce was given, if any."""
        return self._by_nonce.get(robot, {}).get(nonce)
