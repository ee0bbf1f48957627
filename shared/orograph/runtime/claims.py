"""Answers the replicas' claims on robots; liveliness tokens are the leases (architecture.md, "Identity")."""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Callable, Collection

from orograph import keys
from orograph.comms.bus import Bus
from orograph.control import Claim, Grant, Release, Tick
from orograph.runtime import metrics
from orograph.runtime.membership import Membership

log = logging.getLogger("orograph")

UNPROVEN_S = 5.0
"""A claim lasts this long without its liveliness token: who claimed and shows none died in between."""
LEARN_S = 0.3
"""After a restart the tokens of those who hold robots come first, so that none of theirs is given twice."""

REGROUP_S = 8.0
"""A worker that would do more for another robot is released after this time: what died may come back before."""
REVIEW_EVERY_S = 1.0

Instance = tuple[str, str]
"""(service, instance uuid)."""


class Claims:
    """`on_fleet` is told which robots have all their services, whenever that changes once there were `start_with`.

    `revoked` says whom nobody is given.
    """

    def __init__(
        self, robots: tuple[str, ...], on_fleet: Callable[[tuple[str, ...]], None], start_with: int | None = None,
        revoked: Callable[[], Collection[str]] = tuple,
    ) -> None:  # fmt: skip
        self._start_with = len(robots) if start_with is None else start_with
        self._robots, self._on_fleet, self._revoked = robots, on_fleet, revoked
        self._table = Membership(robots)
        self._lock = threading.Lock()
        self._proven: set[Instance] = set()
        self._unproven_since_s: dict[Instance, float] = {}
        self._has_begun = False
        self._stray_since_s: dict[Instance, float] = {}
        self._reviewed_s = 0.0

    def attend(self, bus: Bus) -> None:
        """Learn who lives, then answer."""
        bus.watch_alive(self._on_token)
        time.sleep(LEARN_S)
        bus.answer_each(keys.CLAIM, Claim, self._on_claim)
        bus.hear(keys.TICK, Tick, lambda _: self._review(bus))

    def holders(self) -> dict[str, dict[str, str]]:
        """Robot -> service -> instance that holds it."""
        with self._lock:
            return self._table.holders()

    def _on_token(self, service: str, instance: str, robots: tuple[str, ...], alive: bool) -> None:
        with self._lock:
            if alive:
                self._proven.add((service, instance))
                self._unproven_since_s.pop((service, instance), None)
                self._table.restore([(service, instance, robots)])
            else:
                self._proven.discard((service, instance))
                self._table.lost(service, instance)
            whole = self._table.complete()
            self._has_begun |= len(whole) >= self._start_with
            if self._has_begun:
                self._on_fleet(whole)

    def _on_claim(self, claim: Claim) -> Grant:
        claimant = (claim.service, claim.instance)
        with self._lock:
            self._expire()
            grant = self._table.claim(*claimant, claim.capacity, claim.wanted, self._revoked())
            if grant.robots and claimant not in self._proven:
                self._unproven_since_s.setdefault(claimant, time.monotonic())
        metrics.CLAIMS.labels("granted" if grant.robots else "refused").inc()
        return grant

    def _review(self, bus: Bus) -> None:
        now_s = time.monotonic()
        if now_s - self._reviewed_s < REVIEW_EVERY_S:
            return
        self._reviewed_s = now_s
        with self._lock:
            strays = self._table.strays()
        self._stray_since_s = {stray: self._stray_since_s.get(stray, now_s) for stray in strays}
        for (service, instance), since_s in self._stray_since_s.items():
            if now_s - since_s >= REGROUP_S:
                log.info("another robot needs a %s more: releasing %s", service, instance[:8])
                bus.tell(keys.release_key(instance), Release())

    def _expire(self) -> None:
        for claimant, since_s in list(self._unproven_since_s.items()):
            if time.monotonic() - since_s > UNPROVEN_S:
                self._table.lost(*claimant)
                del self._unproven_since_s[claimant]
