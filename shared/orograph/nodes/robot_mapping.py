"""The robot-mapping service: scans into maps, what is worth it to the Map Manager, what helps to planning."""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt
from numpy.lib.recfunctions import require_fields

from orograph import keys
from orograph.geometry import laser_position_m, ray_directions, rotation
from orograph.layers import UNKNOWN_OCCUPATION, CellMap
from orograph.mapping import RobotMapper
from orograph.mapping.cells import values_of
from orograph.mapping.occupancy import Codes
from orograph.mapping.updates import moved
from orograph.messages import (  # fmt: skip
    SECOND_NS,
    UPDATE,
    Envelope,
    Frame,
    Hello,
    MappingStatus,
    Message,
    OccupancyGrid,
    Packed,
    Phase,
    Pose,
    Scan,
)
from orograph.node import Every, Note, Send
from orograph.protocol.limits import LIMITS, Limits
from orograph.protocol.robot import RobotSync
from orograph.registers import has_evidence
from orograph.rules import Rules
from orograph.scene.site import Site
from orograph.stages import Stage, untimed

BACKLOG_KEPT = 100_000
"""So many seconds of the backlog's course are kept for the report, the newest: more than a day."""
GLOBAL_MAP_NS = 2 * SECOND_NS
POSE_WAIT_FRAMES = 5
"""A scan whose pose has not come for so long is skipped."""


class RobotMappingNode:
    """Glue of `RobotMapper` and `RobotSync`; `nonce` is 16 bytes that no other instance has."""

    def __init__(
        self, site: Site, robot: str, seed: int, nonce: bytes, stage: Stage = untimed, limits: Limits = LIMITS,
    ) -> None:  # fmt: skip
        self.name = keys.node(keys.MAPPING, robot)
        self._navigator = keys.node(keys.NAVIGATOR, robot)
        scenario, grid = site.scenario, site.scenario.grid.grid
        self._mapper = RobotMapper(
            grid, scenario.hrm.cells, scenario.hrm.per_glrm_cell, Rules.of(scenario.rules),
            scenario.laser.range_max_m, scenario.robot.slope_max, site.given, stage,
        )  # fmt: skip
        self._prior = site.prior_map
        self._sync = RobotSync(robot, grid.shape, site.prior, nonce, seed, limits)
        self._arrivals = ScanPoseSync(POSE_WAIT_FRAMES * scenario.frame_ns)
        self._laser, self._directions = scenario.laser, ray_directions(scenario.laser)
        self._initial_hrm: CellMap | None = None
        self._flushing = self._flushed = False
        self._scans = 0
        self._now_ns = self._global_map_due_ns = 0
        self._beat = Every(SECOND_NS)
        self._backlog: deque[tuple[int, int]] = deque(maxlen=BACKLOG_KEPT)
        self._told: tuple[int, ...] = ()
        self._prior_values = values_of(self._prior)
        self._told_codes = self._copied_codes()

    def step(self, frame: Frame, inbox: Sequence[Envelope], send: Send, note: Note) -> None:
        """Map the scans whose pose is known, keep in step with the Map Manager, tell planning."""
        self._now_ns = frame.stamp_ns
        from_manager = self._sort(inbox)
        for scan, pose in self._arrivals.pairs(frame.stamp_ns):
            self._map(scan, pose)
            if self._initial_hrm is not None:
                send(keys.SIM, self._navigator, self._local_map(scan.stamp_ns))
        self._synchronise(from_manager, send, note)
        if self._flushing and not self._flushed:
            self._flush(note)
        if frame.stamp_ns >= self._global_map_due_ns:
            self._tell_global_map(send)
        if self._beat.due(frame.stamp_ns):
            send(keys.RADIO, keys.node(keys.ORCHESTRATOR), self._status())

    def _sort(self, inbox: Sequence[Envelope]) -> list[Message]:
        from_manager: list[Message] = []
        for envelope in inbox:
            match envelope.message:
                case Scan() | Pose() as message:
                    self._arrivals.take(message)
                case Phase() as phase:
                    self._flushing |= phase.name != "mapping"
                case message:
                    from_manager.append(message)
        return from_manager

    def _map(self, scan: Scan, pose: Pose) -> None:
        """One scan into the maps; once the flush has begun the evidence stands still, so that the flush can end."""
        if self._flushing:
            return
        R_map_robot = rotation(pose.roll_rad, pose.pitch_rad, pose.yaw_rad)
        position_m = np.array([pose.x_m, pose.y_m, pose.z_m])
        eye_m = laser_position_m(self._laser, R_map_robot, position_m)
        if self._initial_hrm is None:
            self._mapper.roll_to(eye_m)
            self._initial_hrm = self._mapper.hrm(self._prior)
        self._scans += 1
        self._offer(
            self._mapper.step_scan(
                scan.ranges, self._directions, R_map_robot, eye_m, scan.stamp_ns, self._sync.acknowledged
            )
        )

    def _offer(self, registers: Packed) -> None:
        """Those of them that are away enough from what waits already."""
        self._sync.offer(np.compress(moved(registers, self._sync.own), registers))

    def _synchronise(self, from_manager: Sequence[Message], send: Send, note: Note) -> None:
        epoch, fenced, lost = self._sync.epoch, self._sync.fenced, self._sync.registers_lost

        def send_up(message: Message) -> None:
            if isinstance(message, Hello):
                note("hello", {})
            send(keys.RADIO, keys.MANAGER, message)

        result = self._sync.step(self._now_ns, from_manager, send_up)
        if len(result.adopted):
            self._adopt(result.adopted, result.first_life)
        if self._sync.fenced and not fenced:
            note("fenced", {"epoch": epoch or 0})
        if self._sync.registers_lost > lost:
            note("store-lost", {"registers": self._sync.registers_lost - lost})
        self._flushed &= self._sync.flushed
        if self._sync.epoch is not None and self._sync.epoch != epoch:
            note("welcome", {"epoch": self._sync.epoch, "row_cells": len(result.adopted)})

    def _adopt(self, row: Packed, first_life: bool) -> None:
        """Take the own row over; what it became together with newer evidence is offered if that is worth it."""
        self._mapper.adopt(row, fuse=first_life)
        self._offer(self._mapper.registers())

    def _flush(self, note: Note) -> None:
        """Offer everything, as what differs at all is to be sent; flushed is when nothing of it is left to send."""
        self._sync.offer(self._mapper.registers())
        self._flushed = self._sync.flushed
        if self._flushed:
            note("flushed", {"registers": len(self._mapper.registers())})

    def _tell_global_map(self, send: Send) -> None:
        """The GLRM copy for planning, and as what lies under cells without evidence, if it changed."""
        copy = self._sync.copy
        state = copy.manager_epoch, copy.version, copy.repairs
        if state == self._told:
            return
        self._told, self._global_map_due_ns = state, self._now_ns + GLOBAL_MAP_NS
        grid, self._told_codes = self._prior.grid, self._copied_codes()
        codes = self._told_codes.reshape(grid.shape)
        send(keys.SIM, self._navigator, OccupancyGrid(self._now_ns, *grid.origin_m, grid.cell_m, True, codes))

    def _copied_codes(self) -> Codes:
        cells = self._sync.copy.cells
        return np.where(has_evidence(cells), cells["occupation"], np.uint8(UNKNOWN_OCCUPATION))

    def _local_map(self, stamp_ns: int) -> OccupancyGrid:
        grid = self._mapper.hrm_grid
        codes = self._mapper.planning_occupation(self._prior_values, self._told_codes)
        return OccupancyGrid(stamp_ns, *grid.origin_m, grid.cell_m, False, codes)

    def _status(self) -> MappingStatus:
        copy, waiting = self._sync.copy, self._sync.waiting_cells
        self._backlog.append((self._now_ns, waiting))
        return MappingStatus(self._now_ns, self._flushed, waiting, copy.version, copy.hash())

    def telemetry(self) -> Mapping[str, float]:
        """Scans and points dropped since the start, and the figures of the protocol's robot side."""
        dropped = {f"points_{reason}": float(count) for reason, count in self._mapper.dropped.items()}
        return {
            **self._sync.telemetry(),
            **dropped,
            "scans": float(self._scans),
            "scans_skipped": float(self._arrivals.skipped),
            "link_up": float(self._sync.link_up(self._now_ns)),
        }

    def artifacts(self) -> Mapping[str, npt.NDArray[Any]]:
        """HRM (evidence over prior) now and before the first scan, registers and acknowledged (UPDATE), copy (CELL).

        `backlog` (n, 2) int64: every second its stamp [ns] and how many cells waited for their acknowledgement.
        """
        return {
            **self._hrm_artifacts(),
            "registers": self._mapper.registers(),
            "acknowledged": self._acknowledged(),
            "copy": self._sync.copy.cells,
            "scans": np.array(self._scans, np.int64),
            "backlog": np.array(self._backlog, np.int64).reshape(-1, 2),
        }

    def _acknowledged(self) -> Packed:
        held = self._sync.acknowledged
        updates: Packed = require_fields(held[has_evidence(held)], UPDATE)
        return updates

    def _hrm_artifacts(self) -> dict[str, npt.NDArray[Any]]:
        if self._initial_hrm is None:
            return {}
        hrm = self._mapper.hrm(self._prior)
        return {
            **{f"hrm_{name}": layer for name, layer in hrm.layers()},
            "hrm_origin_m": np.array(hrm.grid.origin_m),
            "hrm_cell_m": np.array(hrm.grid.cell_m),
            "initial_hrm_height": self._initial_hrm.visible,
            "initial_hrm_origin_m": np.array(self._initial_hrm.grid.origin_m),
        }


class ScanPoseSync:
    """Scans and poses that wait for each other; both are of one robot."""

    def __init__(self, wait_ns: int) -> None:
        self._wait_ns = wait_ns
        self._scans: dict[int, Scan] = {}
        self._poses: dict[int, Pose] = {}
        self.skipped = 0

    def take(self, message: Scan | Pose) -> None:
        """Keep a scan or a pose by its stamp."""
        if isinstance(message, Scan):
            self._scans[message.stamp_ns] = message
        else:
            self._poses[message.stamp_ns] = message

    def pairs(self, now_ns: int) -> list[tuple[Scan, Pose]]:
        """Scans whose pose of the same stamp has come, oldest first; what waited too long is forgotten."""
        ready = sorted(self._scans.keys() & self._poses.keys())
        out = [(self._scans.pop(stamp_ns), self._poses[stamp_ns]) for stamp_ns in ready]
        late = [stamp_ns for stamp_ns in self._scans if now_ns - stamp_ns > self._wait_ns]
        self.skipped += len(late)
        for stamp_ns in late:
            del self._scans[stamp_ns]
        self._poses = {s: pose for s, pose in self._poses.items() if now_ns - s <= self._wait_ns}
        return out
