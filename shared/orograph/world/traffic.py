"""Vehicles on their loops: how far each has come, and how it brakes for what stands in its lane.

Pure arithmetic on distances along loops; bodies are `vehicle_body.py`.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from scipy.ndimage import maximum_filter1d

from orograph.arrays import F64
from orograph.scenario import Vehicle
from orograph.scene import Scene

LOOK_AHEAD_M = 8.0
"""Free lane that a vehicle asks for before its nose, and more where it needs more to stop."""
STOP_GAP_M = 2.5
"""Distance it keeps from what it stops for."""
BRAKING_MPS2 = 3.0
SPEEDING_MPS2 = 1.5
SIDE_GAP_M = 0.6
"""Room beside the vehicle that still counts as its lane."""
PATIENCE_S = 5.0
"""Having stood so long, it no longer heeds vehicles of higher index: no two wait for each other for ever."""
STANDING_MPS = 0.05
TABLE_STEP_M = 0.5
DISCS = (-0.35, 0.0, 0.35)
"""Where the discs that stand for a vehicle sit, as shares of its length."""


class Lane:
    """One vehicle on its loop: distance driven and speed."""

    def __init__(self, scene: Scene, index: int, vehicle: Vehicle) -> None:
        self._scene, self._index, self.vehicle = scene, index, vehicle
        self._length_m = scene.vehicle_loop_length_m(index)
        samples = max(3, math.ceil(self._length_m / TABLE_STEP_M))
        self._step_m = self._length_m / samples
        poses = np.array([scene.vehicle_pose(index, k * self._step_m) for k in range(samples)])
        self._table_m, self._half_lane_m = poses[:, :2], half_lane_m(poses[:, 3], self._step_m, vehicle)
        self.distance_m = vehicle.start_fraction * self._length_m
        self.speed_mps = vehicle.speed_mps
        self.waited_s = 0.0
        self._pose_at_m, self._pose = math.nan, (0.0, 0.0, 0.0, 0.0)

    def pose(self) -> tuple[float, float, float, float]:
        """(x, y, z of the ground, yaw) now; computed once for each place, as a frame asks twice."""
        if self._pose_at_m != self.distance_m:
            self._pose_at_m, self._pose = self.distance_m, self._scene.vehicle_pose(self._index, self.distance_m)
        return self._pose

    def gap_m(self, discs_m: F64) -> float:
        """Free lane before the nose, given discs (n, 3) x, y, radius to keep clear of; infinite where none is in it."""
        nose_m = 0.5 * self.vehicle.size_m[0]
        reach_m = nose_m + max(LOOK_AHEAD_M, STOP_GAP_M + self.vehicle.speed_mps**2 / (2 * BRAKING_MPS2))
        discs_m = self._within(reach_m + self._step_m, discs_m)
        if len(discs_m) == 0:
            return math.inf
        ahead_m = np.arange(nose_m, min(reach_m, self._length_m - nose_m), self._step_m)
        rows = np.rint((self.distance_m + ahead_m) / self._step_m).astype(np.int64) % len(self._table_m)
        away_m = np.hypot(*(self._table_m[rows][:, None, :] - discs_m[None, :, :2]).T).T
        blocked = (away_m < discs_m[:, 2] + self._half_lane_m[rows, None]).any(axis=1)
        return float(ahead_m[np.argmax(blocked)] - nose_m) if blocked.any() else math.inf

    def _within(self, reach_m: float, discs_m: F64) -> F64:
        """The discs that the next `reach_m` of the lane could meet: no lane is shorter than the straight line."""
        here_m = self._table_m[round(self.distance_m / self._step_m) % len(self._table_m)]
        dx, dy = discs_m[:, 0] - here_m[0], discs_m[:, 1] - here_m[1]
        far_m = discs_m[:, 2] + (reach_m + self._half_lane_m.max())
        near_m: F64 = discs_m[dx * dx + dy * dy < far_m * far_m]
        return near_m

    def drive(self, gap_m: float, duration_s: float) -> None:
        """Go on for a frame: speed up to the vehicle's own, or brake to stop STOP_GAP_M before the gap's end."""
        allowed = math.sqrt(2 * BRAKING_MPS2 * max(0.0, gap_m - STOP_GAP_M)) if math.isfinite(gap_m) else math.inf
        target = min(self.vehicle.speed_mps, allowed)
        braked, sped_up = self.speed_mps - 2 * BRAKING_MPS2 * duration_s, self.speed_mps + SPEEDING_MPS2 * duration_s
        before, self.speed_mps = self.speed_mps, max(0.0, braked, min(target, sped_up))
        self.distance_m += 0.5 * (before + self.speed_mps) * duration_s
        self.waited_s += duration_s if self.speed_mps < STANDING_MPS else 0.0


def half_lane_m(yaw_rad: F64, step_m: float, vehicle: Vehicle) -> F64:
    """Half the room (n,) that a vehicle needs at places `step_m` apart on its loop, heading along `yaw_rad` (n,).

    In a bend its front swings out.
    """
    half_length_m, half_width_m = 0.5 * vehicle.size_m[0], 0.5 * vehicle.size_m[1]
    turned = np.abs((np.roll(yaw_rad, -1) - np.roll(yaw_rad, 1) + math.pi) % (2 * math.pi) - math.pi)
    radius_m = 2 * step_m / np.maximum(turned, 1e-9)
    swing_m = np.hypot(radius_m + half_width_m, half_length_m) - radius_m - half_width_m
    near = maximum_filter1d(swing_m, 2 * math.ceil(half_length_m / step_m) + 1, mode="wrap")
    room_m: F64 = half_width_m + SIDE_GAP_M + near
    return room_m


class Traffic:
    """All vehicles of a scene."""

    def __init__(self, scene: Scene, vehicles: Sequence[Vehicle]) -> None:
        self.lanes = [Lane(scene, i, vehicle) for i, vehicle in enumerate(vehicles)]

    def drive(self, robots_m: F64, robot_radius_m: float, duration_s: float) -> None:
        """Move all by one frame; robots (n, 2) stand where the frame begins."""
        robots = np.column_stack([robots_m, np.full(len(robots_m), robot_radius_m)])
        vehicles = [_discs(lane) for lane in self.lanes]
        gaps = [self._gap_m(i, robots, vehicles) for i in range(len(self.lanes))]
        for lane, gap in zip(self.lanes, gaps, strict=True):
            lane.drive(gap, duration_s)

    def _gap_m(self, mine: int, robots: F64, vehicles: Sequence[F64]) -> float:
        lane = self.lanes[mine]
        gap_m = lane.gap_m(np.concatenate([robots, *vehicles[:mine], *vehicles[mine + 1 :]]))
        if math.isinf(gap_m):
            lane.waited_s = 0.0
        elif lane.waited_s > PATIENCE_S:
            gap_m = lane.gap_m(np.concatenate([robots, *vehicles[:mine]]))
        return gap_m


def _discs(lane: Lane) -> F64:
    """A vehicle as three discs (3, 3): x, y, radius."""
    length, width, _ = lane.vehicle.size_m
    x, y, _, yaw = lane.pose()
    return np.array([(x + k * length * math.cos(yaw), y + k * length * math.sin(yaw), 0.5 * width) for k in DISCS])
