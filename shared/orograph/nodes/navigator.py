"""Navigator node: sensors, planning maps and missions in; pose, drive and robot status out."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from orograph import keys
from orograph.messages import SECOND_NS, STATES, Drive, Envelope, Frame, Mission, OccupancyGrid, Pose, Sensors
from orograph.navigation.navigator import Navigator
from orograph.node import Every, Note, Send
from orograph.nodes.history import History
from orograph.scene.site import Site

HISTORY_BYTES = 2**21
"""Of a trajectory: every frame of 72 minutes."""


class NavigatorNode:
    """One robot's navigator."""

    def __init__(self, site: Site, robot: str, seed: int) -> None:
        self.name = keys.node(keys.NAVIGATOR, robot)
        self._mapping = keys.node(keys.MAPPING, robot)
        self._navigator = Navigator(site, robot)
        self._trajectory = History(6, site.scenario.frame_ns, HISTORY_BYTES)
        self._beat = Every(SECOND_NS)
        self._visited = 0

    def step(self, frame: Frame, inbox: Sequence[Envelope], send: Send, note: Note) -> None:
        """One frame: estimate the pose, follow the mission, report."""
        sensed = False
        for envelope in inbox:
            match envelope.message:
                case Sensors() as sensors:
                    pose = self._navigator.take_sensors(sensors)
                    sensed = True
                    if self._navigator.pose.started:
                        send(keys.SIM, self._mapping, pose)
                        self._record(pose)
                case OccupancyGrid() as planning_map:
                    self._navigator.take_map(planning_map)
                case Mission() as mission:
                    self._navigator.hear(mission, frame.stamp_ns)
        if sensed:
            command = self._navigator.step(frame.stamp_ns, note)
            send(keys.SIM, keys.WORLD, Drive(frame.stamp_ns, command.v_mps, command.yaw_rate_radps))
        self._report(frame.stamp_ns, send)

    def _record(self, pose: Pose) -> None:
        self._trajectory.append(pose.stamp_ns, pose.x_m, pose.y_m, pose.z_m, pose.yaw_rad, pose.position_sigma_m)

    def _report(self, now_ns: int, send: Send) -> None:
        """Every second, and at once when a waypoint was visited."""
        visited = len(self._navigator.tour.visited)
        if self._beat.due(now_ns) or visited > self._visited:
            self._visited = visited
            send(keys.RADIO, keys.ORCHESTRATOR, self._navigator.status(now_ns))

    def telemetry(self) -> Mapping[str, float]:
        """Position sigma, distance driven, replans, recoveries, waypoints left, and the state's index in STATES."""
        return {**self._navigator.telemetry(), "state": float(STATES.index(self._navigator.state))}

    def artifacts(self) -> Mapping[str, npt.NDArray[Any]]:
        """`trajectory` (n, 6) float64: stamp_ns, x, y, z, yaw, one sigma of x, y; and the metres driven.

        Of a run beyond an hour or so every second frame, then every fourth, ...
        """
        return {"trajectory": self._trajectory.rows(), "driven_m": np.array(self._navigator.pose.moved_m)}
