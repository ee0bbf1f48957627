"""A film of a run that goes on, from what an observer hears."""

from __future__ import annotations

import threading
import time
from collections.abc import Sequence
from functools import partial
from typing import Final

import numpy as np
from numpy.lib.recfunctions import require_fields

from orograph import keys
from orograph.arrays import F64
from orograph.comms.observer import Heard
from orograph.console.film import Event, Film
from orograph.geometry import laser_position_m, ray_directions, roll_pitch_yaw, rotation, rotation_from_quaternion
from orograph.messages import (
    POSE,
    REGISTER,
    ROBOT_REGISTER,
    Batch,
    Bodies,
    Delta,
    MappingStatus,
    Message,
    Packed,
    Pose,
    Scan,
)
from orograph.nodes.cell_history import CellHistory
from orograph.nodes.history import History
from orograph.nodes.robot_mapping import ScanPoseSync
from orograph.points import points_from_ranges
from orograph.protocol.ledger import Ledger
from orograph.protocol.overheard import OverheardMap
from orograph.protocol.store import StoredState
from orograph.registers import of_robot
from orograph.rules import Rules
from orograph.runtime.briefing import Briefing
from orograph.scene.site import Site
from orograph.storage.parts import EventTail

KINDS: Final[tuple[type[Message], ...]] = (Batch, Bodies, Delta, MappingStatus, Pose, Scan)
"""What is listened to."""
COURSE_BYTES, MAP_BYTES = 2**22, 2**25
"""Of one body's course, and of the map's."""
EVENTS_EVERY_S = 1.0
SCAN_WAIT_NS = 500_000_000
SCAN_POINTS = 4_000
"""About so many of a scan are made: whole columns of it are left out."""
ANEW_NS = 10_000_000_000
"""Bodies that are so much older than others are of another run."""


class LiveFilm:
    """`hear` is called from the observer's threads, `film` by the page."""

    def __init__(self, briefing: Briefing) -> None:
        self._briefing, self._site = briefing, Site(briefing.scenario)
        scenario = briefing.scenario
        self._lock, self._frame_ns = threading.Lock(), scenario.frame_ns
        self._robots = {robot: History(6, scenario.frame_ns, COURSE_BYTES) for robot in scenario.robot_ids}
        self._vehicles = [History(4, scenario.frame_ns, COURSE_BYTES) for _ in scenario.vehicles]
        self._backlog = {robot: History(2, scenario.frame_ns, COURSE_BYTES) for robot in scenario.robot_ids}
        self._map, self._overheard = CellHistory(MAP_BYTES), OverheardMap(self._site.prior)
        self._scanned = {robot: ScanPoseSync(SCAN_WAIT_NS) for robot in scenario.robot_ids}
        self._scans: dict[str, tuple[Scan, Pose]] = {}
        self._points: dict[str, tuple[int, F64]] = {}
        self._directions = ray_directions(scenario.laser)
        self._rows: dict[str, Packed] = {}
        self._tail = EventTail(briefing.folder)
        self._events: Sequence[Event] = ()
        self._read_s = -EVENTS_EVERY_S
        self._newest_ns = -1
        self.begun_anew = False
        """Another run has begun since, of which this film knows nothing."""

    def catch_up(self, held: StoredState) -> None:
        """Begin with what had been committed before this film could hear of it; call before `hear`."""
        scenario = self._site.scenario
        ledger = Ledger(self._site.prior, scenario.grid.grid.size, Rules.of(scenario.rules), held)
        self._overheard.catch_up(ledger.glrm, held.manager_epoch)
        self._map.append(0, ledger.glrm[ledger.glrm["version"] > 0])
        for number in held.registers:
            row = ledger.row(number)
            known = self._rows.setdefault(keys.robot_id(number), np.zeros(scenario.grid.grid.size, REGISTER))
            known[row["cell"]] = row

    def hear(self, heard: Heard) -> None:
        """Take one message."""
        robot = keys.split(heard.sender)[1]
        with self._lock:
            match heard.message:
                case Bodies() as bodies:
                    self._take_bodies(bodies)
                case Delta() as delta:
                    self._map.append(heard.frame * self._frame_ns, self._overheard.take(delta))
                case Batch() as batch if robot in self._robots:
                    self._take_registers(robot, batch)
                case MappingStatus(stamp_ns=stamp_ns, waiting_cells=waiting) if robot in self._backlog:
                    self._backlog[robot].append(stamp_ns, waiting)
                case (Scan() | Pose()) as seen:
                    owner = robot if isinstance(seen, Pose) else keys.split(heard.to)[1]
                    self._take_scan(owner, seen)

    def film(self) -> Film:
        """What has been heard so far."""
        self._read_events()
        with self._lock:
            return Film(
                self._site, self._briefing.scenario.title,
                {robot: course.rows() for robot, course in self._robots.items()},
                [course.rows() for course in self._vehicles],
                {robot: course.rows() for robot, course in self._backlog.items()},
                self._map.rows(), self._events, {robot: partial(self._points_of, robot) for robot in self._scans},
                self._registers, live=True,
            )  # fmt: skip

    def _take_bodies(self, bodies: Bodies) -> None:
        if bodies.stamp_ns <= self._newest_ns:
            self.begun_anew |= bodies.stamp_ns < self._newest_ns - ANEW_NS
            return
        self._newest_ns = bodies.stamp_ns
        vehicles = len(self._vehicles)
        robots = bodies.poses[: len(bodies.poses) - vehicles]
        for (_, course), pose in zip(self._robots.items(), robots, strict=False):
            if pose["present"]:
                x, y, z = pose["position_m"]
                course.append(bodies.stamp_ns, x, y, z, _yaw_rad(pose), self._has_radio(x, y))
        for course, pose in zip(self._vehicles, bodies.poses[len(robots) :], strict=False):
            course.append(bodies.stamp_ns, *pose["position_m"][:2], _yaw_rad(pose))

    def _has_radio(self, x_m: float, y_m: float) -> float:
        cell = self._site.scenario.grid.grid.row_col(x_m, y_m)
        return 1.0 if cell is None else float(self._site.given[1][cell] > 0)

    def _take_registers(self, robot: str, batch: Batch) -> None:
        """A robot's registers that are newer than those known, as they went up."""
        known = self._rows.setdefault(robot, np.zeros(self._site.scenario.grid.grid.size, REGISTER))
        told: Packed = batch.records[batch.records["cell"] < len(known)]
        held = known[told["cell"]]
        newer = (batch.epoch > held["epoch"]) | ((batch.epoch == held["epoch"]) & (told["seq"] > held["seq"]))
        rows: Packed = require_fields(told[newer], REGISTER)
        rows["epoch"] = batch.epoch
        known[rows["cell"]] = rows

    def _registers(self) -> Packed:
        with self._lock:
            rows = [of_robot(keys.robot_number(r), known[known["epoch"] > 0]) for r, known in self._rows.items()]
        return np.concatenate([np.zeros(0, ROBOT_REGISTER), *rows])

    def _take_scan(self, robot: str, seen: Scan | Pose) -> None:
        if robot not in self._scanned:
            return
        self._scanned[robot].take(seen)
        for scan, pose in self._scanned[robot].pairs(seen.stamp_ns):
            self._scans[robot] = scan, pose

    def _points_of(self, robot: str) -> F64:
        """Points of the newest scan where the robot believed itself to be; made when they are looked at."""
        scan, pose = self._scans[robot]
        if self._points.get(robot, (-1,))[0] != scan.stamp_ns:
            R_map_robot = rotation(pose.roll_rad, pose.pitch_rad, pose.yaw_rad)
            eye_m = laser_position_m(self._site.scenario.laser, R_map_robot, np.array([pose.x_m, pose.y_m, pose.z_m]))
            few = slice(None, None, max(1, scan.ranges.size // SCAN_POINTS))
            points, _ = points_from_ranges(scan.ranges[:, few], self._directions[:, few], R_map_robot, eye_m)
            self._points[robot] = scan.stamp_ns, points
        return self._points[robot][1]

    def _read_events(self) -> None:
        now_s = time.monotonic()
        if now_s - self._read_s >= EVENTS_EVERY_S:
            self._read_s = now_s
            if news := self._tail.news():
                self._events = sorted((*self._events, *news), key=lambda event: int(event.get("stamp_ns", 0)))


def _yaw_rad(pose: Packed) -> float:
    assert pose.dtype == POSE
    return roll_pitch_yaw(rotation_from_quaternion(pose["quaternion_wxyz"]))[2]
