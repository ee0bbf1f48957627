"""`orchestrator`: who holds which robot, who drives where, when the run ends."""

from __future__ import annotations

import sys
import threading
import time

from orograph import keys
from orograph.edge import wire
from orograph.edge.bus import Bus
from orograph.edge.guard import Guard
from orograph.edge.participant import take_part
from orograph.edge.settings import Settings
from orograph.mission.membership import Membership
from orograph.nodes.fleet import robots_of
from orograph.nodes.orchestrator import OrchestratorNode
from orograph.scenario import Scenario
from orograph.stages import StageRecorder

UNPROVEN_S = 5.0
"""A claim lasts this long without its liveliness token."""


class Claims:
    """Answers the replicas' claims; liveliness tokens are the leases."""

    def __init__(self, robots: tuple[str, ...]) -> None:
        self._table = Membership(robots)
        self._lock = threading.Lock()
        self._unproven: dict[tuple[str, str], float] = {}

    def attend(self, bus: Bus) -> None:
        """Learn who lives, then answer."""
        bus.watch_alive(self._on_token)
        # After a restart the tokens of those who already hold robots come first: none of theirs is given twice.
        time.sleep(0.3)
        bus.answer(keys.CLAIM, self._on_claim)

    def _on_token(self, service: str, instance: str, robots: tuple[str, ...], alive: bool) -> None:
        with self._lock:
            self._unproven.pop((service, instance), None)
            if alive:
                self._table.restore([(service, instance, robots)])
            else:
                self._table.lost(service, instance)

    def _on_claim(self, payload: bytes) -> bytes:
        question = wire.unpack_plain(payload)
        with self._lock:
            self._expire()
            grant = self._table.claim(
                question["service"], question["instance"], question["capacity"], tuple(question["wanted"])
            )
            if grant.robots:
                self._unproven.setdefault((question["service"], question["instance"]), time.monotonic())
        return wire.pack_plain({"robots": list(grant.robots), "reason": grant.reason})

    def _expire(self) -> None:
        """Who claimed and never showed a token died in between."""
        for claimant, since_s in list(self._unproven.items()):
            if time.monotonic() - since_s > UNPROVEN_S:
                self._table.lost(*claimant)
                del self._unproven[claimant]


def main() -> None:
    """Run the service."""
    guard = Guard(keys.ORCHESTRATOR, "--with-parent" in sys.argv)
    settings = Settings.from_environment()
    claims = Claims(robots_of(settings.scenario()))

    def build(scenario: Scenario, robots: tuple[str, ...]) -> tuple[list[OrchestratorNode], dict[str, StageRecorder]]:
        return [OrchestratorNode(scenario, robots_of(scenario), scenario.seed)], {}

    take_part(keys.ORCHESTRATOR, settings, guard, build, attend=claims.attend)


if __name__ == "__main__":
    main()
