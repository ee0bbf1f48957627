"""Managers and an orchestrator that get one thing wrong about a robot that is revoked."""

from __future__ import annotations

from dataclasses import replace

from orograph.nodes.orchestrator import OrchestratorNode
from orograph.protocol.manager import ManagerSync

REVOKED = [seed for seed in range(2, 400, 4) if seed % 5 != 4 and (seed % 3 == 0 or seed % 7)]
"""Storms in which a robot is revoked."""


class RevokesInMemoryOnly(ManagerSync):
    seeds = REVOKED

    def _commit(self, changes):
        return super()._commit(replace(changes, revoked=()))


class RevokesTheRegistersOnly(ManagerSync):
    """Takes what the robot sends later."""

    seeds = REVOKED

    def _take_in(self, now_ns, inbox):
        revoked, self._revoked = self._revoked, frozenset()
        try:
            return super()._take_in(now_ns, inbox)
        finally:
            self._revoked = revoked


class RevokesTheRobotOnly(ManagerSync):
    """Takes nothing more, and keeps in the map what it had."""

    seeds = REVOKED

    def __init__(self, *args, **kwargs):
        super().__init__(*args, **kwargs)
        withdrawal = self._ledger.withdrawal
        self._ledger.withdrawal = lambda robot, now_ns: withdrawal(99, now_ns)


class WaitsForTheRevoked(OrchestratorNode):
    seeds = REVOKED

    def _gone(self, patrol):
        return super()._gone(patrol) - self.revoked


REVOCATION = (
    RevokesInMemoryOnly, RevokesTheRegistersOnly, RevokesTheRobotOnly, WaitsForTheRevoked,
)  # fmt: skip
