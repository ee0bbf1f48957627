"""The world's step object: drives in, bodies and sensor readings out; owner of the truth and of simulation time."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy.typing as npt

from orograph import keys
from orograph.geometry import roll_pitch_yaw, wrap_angle
from orograph.layers import Layer
from orograph.messages import Bodies, Drive, Envelope, Frame, RunEnd
from orograph.node import Note, Send
from orograph.nodes.history import History
from orograph.scenario import Change, Scenario
from orograph.scene.changes import epoch
from orograph.scene.prior import given_layers
from orograph.world import World
from orograph.world.contacts import Contact, ContactBook, touched
from orograph.world.navigation_sensors import Motion, NavigationSensors

DRIVE_TIMEOUT_NS = 500_000_000
"""A robot that hears nothing from its navigator for so long stops."""
ROBOT_COLUMNS, VEHICLE_COLUMNS = ("x", "y", "z", "yaw", "v", "radio"), ("x", "y", "yaw")
HISTORY_BYTES = 2**26
"""Of the courses of all bodies: every frame of 7 hours for 3 robots and 4 vehicles, of 23 minutes for 100 robots."""
TIPPED_COSINE = 0.5
"""A robot whose up axis is more than 60 degrees off the vertical lies on its side."""


class WorldNode:
    """Advances physics by one frame per step and tells lasers and navigators what there is."""

    name = keys.WORLD

    def __init__(self, scenario: Scenario, robots: tuple[str, ...], seed: int) -> None:
        self.scenario, self.robots = scenario, robots
        self.world = World(scenario, robots)
        self.present: set[str] = set(robots)
        """Robots that have a body; the shell changes it, the next step follows."""
        self.ended: RunEnd | None = None
        """Set once the orchestrator has ended the run."""
        self._gps_quality, self._communications = given_layers(scenario)
        self._sensors = {robot: NavigationSensors(scenario, seed, robot) for robot in robots}
        self._drives: dict[str, tuple[int, Drive]] = {}
        self._yaw_rad = {robot: self._yaw(robot) for robot in robots}
        self._radio_up = self.radio_up()
        self._tipped: set[str] = set()
        self._book, self._contacts = ContactBook(), 0
        self._epoch = (False,) * len(scenario.changes)
        self._frame = 0
        columns = 1 + len(ROBOT_COLUMNS) * len(robots) + len(VEHICLE_COLUMNS) * len(scenario.vehicles)
        self._history = History(columns, scenario.frame_ns, HISTORY_BYTES)

    def step(self, frame: Frame, inbox: Sequence[Envelope], send: Send, note: Note) -> None:
        """Drive on to this frame's stamp with the newest Drives, then send Bodies and Sensors."""
        self._frame = frame.index
        self._take(frame, inbox)
        for robot in self.robots:
            (self.world.add_robot if robot in self.present else self.world.remove_robot)(robot)
        if frame.stamp_ns > self.world.stamp_ns:
            self.world.advance(self._wanted(frame), frame.stamp_ns - self.world.stamp_ns)
        if frame.index % self.scenario.laser.period_frames == 0:
            send(keys.SIM, keys.group(keys.LASER), Bodies(frame.stamp_ns, self.world.poses()))
        for robot in self.robots:
            self._sense(frame, robot, send)
        self._watch(note)
        self._watch_contacts(frame, note)
        self._record(frame)

    def radio_up(self) -> dict[str, bool]:
        """Whether each robot stands where the communications layer is not 0; outside the grid there is radio."""
        return {robot: self._given(self._communications, robot, outside=1) > 0 for robot in self.robots}

    def telemetry(self) -> Mapping[str, float]:
        """Robots with a body, vehicles, robots without radio, contacts so far, and the frame."""
        silent = sum(not up for up in self._radio_up.values())
        vehicles = len(self.scenario.vehicles)
        figures = {"robots": len(self.present), "vehicles": vehicles, "robots_without_radio": silent}
        return {**figures, "contacts": self._contacts, "frame": self._frame}

    def artifacts(self) -> Mapping[str, npt.NDArray[Any]]:
        """Per frame, of a long run every second, fourth, ..., float64 in metres, radians, m/s:

        `<robot>_truth` (n, 6) stamp_ns, x, y, z, yaw, v;
        `vehicle_<i>_path` (n, 4) stamp_ns, x, y, yaw; and `<robot>_radio` (n,) bool.
        """
        rows, out, column = self._history.rows(), dict[str, npt.NDArray[Any]](), 1
        for robot in self.robots:
            out[f"{robot}_truth"] = rows[:, [0, *range(column, column + 5)]]
            out[f"{robot}_radio"] = rows[:, column + 5] > 0
            column += len(ROBOT_COLUMNS)
        for i in range(len(self.scenario.vehicles)):
            out[f"vehicle_{i:03d}_path"] = rows[:, [0, *range(column, column + 3)]]
            column += len(VEHICLE_COLUMNS)
        return out

    def _take(self, frame: Frame, inbox: Sequence[Envelope]) -> None:
        for envelope in inbox:
            robot = keys.split(envelope.sender)[1]
            if isinstance(envelope.message, Drive) and robot in self._sensors:
                self._drives[robot] = frame.stamp_ns, envelope.message
            elif isinstance(envelope.message, RunEnd):
                self.ended = envelope.message

    def _wanted(self, frame: Frame) -> dict[str, tuple[float, float]]:
        """Drives that still hold."""
        return {
            robot: (drive.v_mps, drive.yaw_rate_radps)
            for robot, (heard_ns, drive) in self._drives.items()
            if frame.stamp_ns - heard_ns < DRIVE_TIMEOUT_NS
        }

    def _sense(self, frame: Frame, robot: str, send: Send) -> None:
        yaw_before, self._yaw_rad[robot] = self._yaw_rad[robot], self._yaw(robot)
        if robot not in self.present:
            return
        turned_rad = wrap_angle(self._yaw_rad[robot] - yaw_before)
        motion = Motion(
            self.world.position_m(robot),
            self.world.rotation(robot),
            turned_rad * 1e9 / frame.duration_ns,
            self.world.wheel_odometry(robot)[0],
        )
        quality = self._given(self._gps_quality, robot, outside=0)
        reading = self._sensors[robot].read(motion, quality, frame.stamp_ns, frame.index)
        send(keys.SIM, keys.node(keys.NAVIGATOR, robot), reading)

    def _watch(self, note: Note) -> None:
        for i, holds in enumerate(now := epoch(self.scenario, self.world.stamp_ns)):
            if holds != self._epoch[i]:
                note("scene-changed", {"change": i, "what": _what(self.scenario.changes[i], holds)})
        self._epoch = now
        radio_up = self.radio_up()
        for robot in self.robots:
            if radio_up[robot] != self._radio_up[robot]:
                note("radio-found" if radio_up[robot] else "radio-lost", {"robot": robot, **self._place(robot)})
            tipped = self.world.rotation(robot)[2, 2] < TIPPED_COSINE
            if tipped and robot not in self._tipped:
                self._tipped.add(robot)
                note("robot-tipped", {"robot": robot, **self._place(robot)})
        self._radio_up = radio_up

    def _watch_contacts(self, frame: Frame, note: Note) -> None:
        """Note each collision once it is over, or when the run is."""
        for robot, newtons in self.world.pushes().items():
            others = self.world.outlines()
            mine = others.pop(robot)
            body, now_ns = touched(mine, others), frame.stamp_ns
            began = Contact(robot, body, mine.x_m, mine.y_m, now_ns, now_ns, newtons, frame.duration_ns * 1e-9)
            self._contacts += self._book.push(began)
        for contact in self._book.rest() if self.ended else self._book.over(frame.stamp_ns):
            note("contact", {
                "robot": contact.robot, "body": contact.body, "since_s": contact.since_ns * 1e-9,
                "newtons": round(contact.newtons), "seconds": round(contact.seconds, 3),
                "x_m": round(contact.x_m, 2), "y_m": round(contact.y_m, 2),
            })  # fmt: skip

    def _record(self, frame: Frame) -> None:
        row: list[float] = []
        for robot in self.robots:
            row += self.world.position_m(robot).tolist()
            row += self._yaw_rad[robot], self.world.speed_mps(robot), float(self._radio_up[robot])
        self._history.append(frame.stamp_ns, *row, *self.world.vehicle_poses().reshape(-1).tolist())

    def _given(self, layer: Layer, robot: str, outside: int) -> int:
        x, y, _ = self.world.position_m(robot).tolist()
        cell = self.scenario.grid.grid.row_col(x, y)
        return outside if cell is None else int(layer[cell])

    def _yaw(self, robot: str) -> float:
        return roll_pitch_yaw(self.world.rotation(robot))[2]

    def _place(self, robot: str) -> dict[str, float]:
        x, y, _ = self.world.position_m(robot).tolist()
        return {"x_m": round(x, 2), "y_m": round(y, 2)}


def _what(change: Change, holds: bool) -> str:
    """What has just happened, in a word."""
    words = ("built", "pulled down") if change.build else ("parked", "left") if change.park else ("removed", "rebuilt")
    return words[0] if holds else words[1]
