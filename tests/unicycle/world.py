"""One robot that moves as commanded (with limits, lag and noise) among boxes, and the maps it would be sent."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np
from orograph.keys import NAVIGATOR, ORCHESTRATOR, RADIO, SIM, WORLD, node
from orograph.messages import Drive, Envelope, Frame, Mission, OccupancyGrid, Sensors
from orograph.nodes.navigator import NavigatorNode
from orograph.randomness import stream
from orograph.scenario import Scenario
from orograph.scene.site import Site

Box = tuple[float, float, float, float]
FRAME_NS = 100_000_000
NAME = node(NAVIGATOR, "robot_001")
BODY_M = 0.3


def scenario_of(patrol: Sequence[tuple[float, float]], start: tuple[float, float, float] = (12.5, 12.5, 0.0), **fields):
    """A flat 100 m x 100 m scenario."""
    x, y, heading = start
    return Scenario.model_validate(
        {
            "name": "flat",
            "title": "flat",
            "robots": 1,
            "grid": {"cell_m": 5.0, "rows": 20, "cols": 20},
            "hrm": {"cells": 160, "per_glrm_cell": 10},
            "starts": [{"x_m": x, "y_m": y, "heading_deg": heading}],
            "base_station_m": (12.5, 12.5),
            "patrol": list(patrol),
            **fields,
        }
    )


@dataclass
class UnicycleWorld:
    """Boxes [x0, y0, x1, y1]: `buildings` are in the prior, `surprises` are not; `mover(t)` gives a box or None."""

    scenario: Scenario
    buildings: Sequence[Box] = ()
    surprises: Sequence[Box] = ()
    mover: Callable[[float], Box | None] = lambda t: None
    seed: int = 1
    map_noise: float = 0.002
    radio: Callable[[float, float], bool] = lambda x, y: True
    gps: Callable[[float, float], int] = lambda x, y: 2
    waypoints: Sequence[int] | None = None
    jammed: Callable[[float], bool] = lambda t: False
    maps_until_s: float = math.inf
    notes: list[tuple[float, str, dict]] = field(default_factory=list)
    statuses: list = field(default_factory=list)
    hits: list[tuple[float, float, float]] = field(default_factory=list)
    track: list[tuple[float, ...]] = field(default_factory=list)
    poses: list = field(default_factory=list)

    def __post_init__(self) -> None:
        start = self.scenario.starts[0]
        self.x, self.y, self.yaw = start.x_m, start.y_m, math.radians(start.heading_deg)
        self.v = self.w = self.turn_rate = 0.0
        self.command = (0.0, 0.0)
        self.scale = 1 + 0.01 * stream(self.seed, "scale").standard_normal()
        self.node = NavigatorNode(Site(self.scenario), "robot_001", self.seed)
        self._late: dict[int, list] = {}
        self._inbox: list[Envelope] = []
        self._remembered: list[tuple[float, Box]] = []
        self.index = 0

    def boxes(self, t: float) -> list[Box]:
        mover = self.mover(t)
        return [*self.buildings, *self.surprises, *([mover] if mover else [])]

    def touches(self, x: float, y: float, t: float, margin: float = BODY_M) -> bool:
        return any(x0 - margin < x < x1 + margin and y0 - margin < y < y1 + margin for x0, y0, x1, y1 in self.boxes(t))

    def run(self, seconds: float, until: Callable[[UnicycleWorld], bool] = lambda w: False) -> UnicycleWorld:
        for _ in range(round(seconds * 10)):
            self.frame()
            if until(self):
                break
        return self

    def frame(self) -> None:
        """World steps frame k, then the navigator steps frame k with what was sent in k - 1."""
        k, t = self.index, self.index * 0.1
        inbox, self._inbox = self._inbox, []
        command = self.command
        if k:
            self._move(t)
        self._inbox.append(self._envelope(SIM, WORLD, self._sensors(k)))
        self._send_maps(k, t)
        self._inbox += self._late.pop(k, [])
        if k % 10 == 0 and self.radio(self.x, self.y):
            indices = range(len(self.scenario.patrol)) if self.waypoints is None else self.waypoints
            self._inbox.append(self._envelope(RADIO, ORCHESTRATOR, Mission(1, np.array(indices, "<u2"), False)))
        self.node.step(Frame(k, k * FRAME_NS, FRAME_NS), inbox, self._take, self._note)
        self.track.append((t, self.x, self.y, self.yaw, self.v, *command))
        self.index += 1

    def _take(self, plane: str, to: str, message) -> None:
        if isinstance(message, Drive):
            self.command = (message.v_mps, message.yaw_rate_radps)
        elif plane == RADIO:
            self.statuses.append(message)
        else:
            self.poses.append((message, self.truth[round(message.stamp_ns / FRAME_NS)]))

    def _note(self, kind: str, fields) -> None:
        self.notes.append((self.index * 0.1, kind, dict(fields)))

    def kinds(self) -> list[str]:
        return [kind for _, kind, _ in self.notes]

    def _envelope(self, plane: str, sender: str, message) -> Envelope:
        return Envelope(plane, NAME, sender, self.index, 0, message)

    def _move(self, t: float) -> None:
        v, w = self.command if not self.jammed(t) else (0.0, 0.0)
        self.v += max(-0.2, min(0.2, v - self.v))
        before = self.w
        self.w += max(-0.5, min(0.5, w - self.w))
        yaw = self.yaw + 0.05 * (before + self.w)
        x = self.x + 0.1 * self.v * math.cos(0.5 * (self.yaw + yaw))
        y = self.y + 0.1 * self.v * math.sin(0.5 * (self.yaw + yaw))
        if self.touches(x, y, t) and not self.touches(self.x, self.y, t - 0.1):
            self.hits.append((t, x, y))
            self.v = 0.0
            x, y = self.x, self.y
        self.turn_rate = (yaw - self.yaw) / 0.1
        self.x, self.y, self.yaw = x, y, yaw

    @property
    def truth(self) -> list[tuple[float, float, float]]:
        if not hasattr(self, "_truth"):
            self._truth: list[tuple[float, float, float]] = []
        return self._truth

    def _sensors(self, k: int) -> Sensors:
        self.truth.append((self.x, self.y, self.yaw))
        n = stream(self.seed, "sensors", frame=k).standard_normal(10)
        spec, quality = self.scenario.navigation_sensors, self.gps(self.x, self.y)
        sigma = {0: 1000.0, 1: spec.gps_single_m, 2: spec.gps_differential_m}[quality]
        roll, pitch = n[3:5] * math.radians(spec.attitude_deg)
        yaw = (self.yaw + n[5] * math.radians(spec.heading_deg) + math.pi) % (2 * math.pi) - math.pi
        v = self.v * self.scale + n[7] * spec.odometry_mps
        return Sensors(k * FRAME_NS, quality, self.x + sigma * n[0], self.y + sigma * n[1], 1.5 * sigma * n[2],
                       roll, pitch, yaw, self.turn_rate + n[6] * spec.yaw_rate_radps, v)  # fmt: skip

    def _send_maps(self, k: int, t: float) -> None:
        if k == 2 or (k > 2 and k % 20 == 2):
            occupation = np.zeros((20, 20), np.uint8)
            self._paint(occupation, self.buildings, 0.0, 0.0, 5.0)
            self._inbox.append(self._envelope(SIM, "m", OccupancyGrid(k * FRAME_NS, 0.0, 0.0, 5.0, True, occupation)))
        if k % 4 == 0 and t < self.maps_until_s:
            self._late[k + 2] = [self._envelope(SIM, "m", self._local_map(k, t))]

    def _local_map(self, k: int, t: float) -> OccupancyGrid:
        """80 m x 80 m; surprises within 25 m only; a mover's trace stays for 6 s unless the robot is within 3 m."""
        x0, y0 = math.floor(self.x / 5) * 5 - 40.0, math.floor(self.y / 5) * 5 - 40.0
        mover = self.mover(t)
        if mover:
            self._remembered.append((t, mover))
        self._remembered = [(s, b) for s, b in self._remembered if s == t or (t - s < 6 and self._away(b) > 3)]
        near = [b for b in self.surprises if self._away(b) < 25]
        occupation = (stream(self.seed, "map", frame=k).random((160, 160)) < self.map_noise).astype(np.uint8) * 254
        self._paint(occupation, [*self.buildings, *near, *(b for _, b in self._remembered)], x0, y0, 0.5)
        return OccupancyGrid(k * FRAME_NS, x0, y0, 0.5, False, occupation)

    def _away(self, box: Box) -> float:
        x0, y0, x1, y1 = box
        return math.hypot(max(x0 - self.x, 0, self.x - x1), max(y0 - self.y, 0, self.y - y1))

    @staticmethod
    def _paint(occupation: np.ndarray, boxes: Sequence[Box], x0: float, y0: float, cell: float) -> None:
        rows, cols = occupation.shape
        x, y = x0 + (np.arange(cols) + 0.5) * cell, y0 + (np.arange(rows) + 0.5) * cell
        for a, b, c, d in boxes:
            hit = ((y > b - cell / 2) & (y < d + cell / 2))[:, None] & ((x > a - cell / 2) & (x < c + cell / 2))[None]
            occupation[hit] = 254
