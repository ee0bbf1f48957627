"""The map-manager service: registers up from every robot's mapping, the GLRM down to all of them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from orograph import keys
from orograph.control import Revoke, Revoked
from orograph.messages import SECOND_NS, Envelope, Frame, ManagerStatus, Message, Packed
from orograph.node import Every, Note, Send
from orograph.nodes.cell_history import CellHistory
from orograph.protocol.limits import LIMITS, Limits
from orograph.protocol.manager import ManagerSync
from orograph.protocol.store import Store
from orograph.rules import Rules
from orograph.scene.site import Site
from orograph.stages import Stage, untimed

HISTORY_BYTES = 2**25
"""Of the map's course: 800 000 changes of cells."""
COVERAGE = np.dtype([("stamp_ns", "<i8"), ("confident_cells", "<u4"), ("version", "<u4")])


class MapManagerNode:
    """Glue of `ManagerSync`; raises StoreFailed from `step`, upon which the process must end and recover.

    `draw` is a random number of 31 bits.
    """

    def __init__(
        self, site: Site, robots: tuple[str, ...], store: Store, stage: Stage = untimed,
        limits: Limits = LIMITS, draw: int = 0,
    ) -> None:  # fmt: skip
        self.name = keys.node(keys.MANAGER)
        scenario, grid, self._robots = site.scenario, site.scenario.grid.grid, robots
        self._prior = site.prior
        rules = Rules.of(scenario.rules)
        self._sync = ManagerSync(grid.shape, self._prior, rules, store, robots, stage, limits, draw)
        self._status = Every(SECOND_NS)
        self._coverage: list[tuple[int, int, int]] = []
        self._history, self._kept_version = CellHistory(HISTORY_BYTES), 0
        self._now_ns = 0

    def step(self, frame: Frame, inbox: Sequence[Envelope], send: Send, note: Note) -> None:
        """Give the robots' messages to the protocol, what comes out to the radio."""
        from_robots = [(keys.split(envelope.sender)[1], envelope.message) for envelope in inbox]

        def send_to(robot: str | None, message: Message) -> None:
            to = keys.group(keys.MAPPING) if robot is None else keys.node(keys.MAPPING, robot)
            send(keys.RADIO, to, message)

        self._now_ns = frame.stamp_ns
        self._sync.step(frame.stamp_ns, from_robots, send_to, note)
        if self._status.due(frame.stamp_ns):
            self._report(frame.stamp_ns, send)

    @property
    def revoked(self) -> tuple[str, ...]:
        """Robots whose revocation would survive kill -9."""
        return self._sync.revoked

    def take_revoke(self, asked: Revoke) -> Revoked:
        """What a person asks, from any thread: done in the next step, so ask again until the answer names the robot."""
        if asked.robot not in self._robots:
            return Revoked(self.revoked, f"{asked.robot} is not in this run of {len(self._robots)} robots")
        self._sync.revoke(asked.robot)
        return Revoked(self.revoked, "")

    def _report(self, now_ns: int, send: Send) -> None:
        confident, version = self._sync.confident_cells, self._sync.version
        self._coverage.append((now_ns, confident, version))
        self._keep(now_ns)
        status = ManagerStatus(now_ns, version, self._sync.hash(), confident, self._revoked_numbers())
        send(keys.RADIO, keys.node(keys.ORCHESTRATOR), status)

    def _revoked_numbers(self) -> Packed:
        return np.array([keys.robot_number(robot) for robot in self.revoked], "<u2")

    def _keep(self, now_ns: int) -> None:
        glrm = self._sync.glrm
        self._history.append(now_ns, glrm[glrm["version"] > self._kept_version])
        self._kept_version = self._sync.version

    def telemetry(self) -> Mapping[str, float]:
        """Figures of the protocol's manager side."""
        return self._sync.telemetry()

    def artifacts(self) -> Mapping[str, npt.NDArray[Any]]:
        """Final `glrm` (CELL), `prior` (UPDATE), `registers` (ROBOT_REGISTER), first confident, coverage, acks.

        `revoked` are numbers of robots; `changed_ms` (cells,) when a surface last changed, -1 for never; `changes` (n,)
        CHANGE what of the map changed, second by second since this manager started.
        """
        self._keep(self._now_ns)
        return {
            "changes": self._history.rows(),
            "glrm": self._sync.glrm,
            "prior": self._prior,
            "registers": self._sync.registers(),
            "first_confident_ns": self._sync.first_confident_ns,
            "coverage": np.array(self._coverage, COVERAGE),
            "acked_records": np.array([self._sync.acked[robot] for robot in self._robots], np.int64),
            "glrm_hash": np.frombuffer(self._sync.hash(), np.uint8),
            "version": np.array(self._sync.version, np.int64),
            "revoked": self._revoked_numbers(),
            "changed_ms": self._sync.changed_ms,
            "manager_epoch": np.array(self._sync.manager_epoch, np.int64),
        }
