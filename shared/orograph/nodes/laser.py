"""The laser service of one robot: bodies in, one range image out."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from orograph import keys
from orograph.messages import POSE, Bodies, Envelope, Frame, Scan
from orograph.node import Note, Send
from orograph.sensing import Laser, View


class LaserNode:
    """Scans whenever the world has told where everything is."""

    def __init__(self, view: View, robot: str, seed: int, robots: tuple[str, ...]) -> None:
        assert robot in robots, (robot, robots)
        self.name = keys.node(keys.LASER, robot)
        self._to = keys.node(keys.MAPPING, robot)
        self._index, self._seed = keys.robot_number(robot) - 1, seed
        self._view, self._robot, laser = view, robot, view.scenario.laser
        self._laser = Laser(view.scenario, robot, view.imager(0))
        self._scans, self._last = 0, Scan(0, np.zeros((laser.rings, laser.columns), "<u2"))
        self._last_pose = np.zeros((), POSE)

    def step(self, frame: Frame, inbox: Sequence[Envelope], send: Send, note: Note) -> None:
        """Scan the newest Bodies; nothing while the robot is not in the world."""
        heard = [envelope.message for envelope in inbox if isinstance(envelope.message, Bodies)]
        if not heard:
            return
        bodies = max(heard, key=lambda message: message.stamp_ns)
        if (imager := self._view.imager(bodies.stamp_ns)) is not self._laser.imager:
            self._laser = Laser(self._view.scenario, self._robot, imager)
        ranges = self._laser.scan(bodies.poses, self._seed, frame.index)
        if ranges is None:
            return
        self._scans, self._last = self._scans + 1, Scan(bodies.stamp_ns, ranges)
        self._last_pose = bodies.poses[self._index].copy()
        send(keys.SIM, self._to, self._last)

    def telemetry(self) -> Mapping[str, float]:
        """Scans made, and which share of the last one's rays came back."""
        hits = np.count_nonzero(self._last.ranges) / self._last.ranges.size
        return {"scans": float(self._scans), "hits_fraction": float(hits)}

    def artifacts(self) -> Mapping[str, npt.NDArray[Any]]:
        """The last scan: stamp, ranges (rings, columns) u2, and the robot's true pose then (POSE fields)."""
        return {
            "last_stamp_ns": np.array(self._last.stamp_ns, np.int64),
            "last_ranges": self._last.ranges,
            "last_position_m": self._last_pose["position_m"],
            "last_quaternion_wxyz": self._last_pose["quaternion_wxyz"],
        }
