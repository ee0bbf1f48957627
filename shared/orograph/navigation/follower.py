"""Path following by regulated pure pursuit: slow in curves, near obstacles and at the end; turns on the spot."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from orograph.arrays import F64
from orograph.geometry import wrap_angle
from orograph.navigation.planner import LETHAL_M, LocalPath
from orograph.scenario import RobotSpec

CRUISE_SHARE = 0.85
"""Of the robot's top speed: skid-steer wheels that run at the limit have none left to steer with."""
BRAKE_MPS2, BRAKE_HARD_MPS2 = 1.2, 2.0
LATERAL_MPS2 = 1.5
STOP_SHORT_M = 0.3
DELAY_S = 0.3
"""From the sensors' stamp to the wheels: two frames and the wheels' own lag."""
NARROW_MPS, WIDE_M = 0.8, 2.0
"""Speed where obstacles are as near as they may be, and the distance from which on they do not matter."""
CREEP_MPS = 0.5
TURN_BEGIN_RAD, TURN_END_RAD, TURN_GAIN = 1.0, 0.25, 2.5
SLOWEST_MPS = 0.3
"""Below this speed the sideways pull of turning does not matter."""
YAW_RATE_SHARE = 0.75


@dataclass(frozen=True)
class Command:
    """Wanted speed of the body."""

    v_mps: float
    yaw_rate_radps: float


STOP = Command(0.0, 0.0)


class Follower:
    """Follows one path at a time; asked once per frame for a command."""

    def __init__(self, robot: RobotSpec) -> None:
        self._cruise_mps = CRUISE_SHARE * robot.speed_max_mps
        self._yaw_rate_max = YAW_RATE_SHARE * robot.yaw_rate_max_radps
        self._turning = False
        self._nearest = 0
        self.path: LocalPath | None = None
        self.arc_m: F64 = np.zeros(1)
        self._limit_mps: F64 = np.zeros(1)

    def take(self, path: LocalPath | None) -> None:
        """Follow another path from its beginning, or none."""
        self.path, self._nearest = path, 0
        if path is not None:
            steps = np.hypot(*np.diff(path.xy_m, axis=0).T)
            self.arc_m = np.concatenate([[0.0], np.cumsum(steps)])
            self._limit_mps = speed_profile(path, self.arc_m, self._cruise_mps)

    def advance(self, x_m: float, y_m: float) -> float:
        """Metres along the path to where the robot is, searched forward from the last time."""
        assert self.path is not None
        end = int(self.arc_m.searchsorted(self.arc_m[self._nearest] + 6.0)) + 1
        part = self.path.xy_m[self._nearest : end]
        self._nearest += int(np.argmin((part[:, 0] - x_m) ** 2 + (part[:, 1] - y_m) ** 2))
        near = self._nearest
        before, after = max(near - 1, 0), min(near + 1, len(self.arc_m) - 1)
        dx, dy = self.path.xy_m[after] - self.path.xy_m[before]
        px, py = (x_m, y_m) - self.path.xy_m[near]
        ahead_m = float(px * dx + py * dy) / max(math.hypot(dx, dy), 1e-9)
        return float(self.arc_m[near]) + max(-0.5, min(0.5, ahead_m))

    @property
    def remaining_m(self) -> float:
        """Metres of path left."""
        return float(self.arc_m[-1] - self.arc_m[self._nearest]) if self.path is not None else 0.0

    def off_path_m(self, x_m: float, y_m: float) -> float:
        """Distance from the robot to the path; call after `advance`."""
        assert self.path is not None
        x, y = self.path.xy_m[self._nearest]
        return math.hypot(x - x_m, y - y_m)

    def command(self, x_m: float, y_m: float, yaw_rad: float, v_mps: float, free_m: float) -> Command:
        """What to do now, at speed `v_mps`, with `free_m` metres of free path ahead; call after `advance`."""
        assert self.path is not None
        lookahead_m = min(max(1.0, 0.5 + 0.8 * abs(v_mps)), 3.0)
        target = min(int(self.arc_m.searchsorted(self.arc_m[self._nearest] + lookahead_m)), len(self.arc_m) - 1)
        dx, dy = self.path.xy_m[target] - (x_m, y_m)
        distance, bearing = math.hypot(dx, dy), wrap_angle(math.atan2(dy, dx) - yaw_rad)
        self._turning = abs(bearing) > (TURN_END_RAD if self._turning else TURN_BEGIN_RAD)
        rate_max = min(self._yaw_rate_max, LATERAL_MPS2 / max(abs(v_mps), SLOWEST_MPS))
        if self._turning:
            return Command(0.0, max(-rate_max, min(rate_max, TURN_GAIN * bearing)))
        curvature = 2 * math.sin(bearing) / max(distance, 0.3)
        bend = max(abs(curvature), 1e-6)
        v = min(self._speed(v_mps, free_m), self._yaw_rate_max / bend, math.sqrt(LATERAL_MPS2 / bend))
        return Command(v, max(-rate_max, min(rate_max, v * curvature)))

    def _speed(self, v_mps: float, free_m: float) -> float:
        lag_m = DELAY_S * abs(v_mps)
        soon = min(int(self.arc_m.searchsorted(self.arc_m[self._nearest] + lag_m)), len(self.arc_m) - 1)
        stop_mps = math.sqrt(2 * BRAKE_MPS2 * max(0.0, free_m - STOP_SHORT_M - lag_m))
        return min(float(self._limit_mps[soon]), stop_mps)


def braking_distance_m(v_mps: float) -> float:
    """Metres the robot needs to stop from a speed, its lag included."""
    return DELAY_S * abs(v_mps) + v_mps**2 / (2 * BRAKE_HARD_MPS2)


def speed_profile(path: LocalPath, arc_m: F64, cruise_mps: float) -> F64:
    """Greatest speed (n,) at each path point, so that every slower place ahead can be reached by braking."""
    width = np.clip((path.clearance_m - LETHAL_M) / (WIDE_M - LETHAL_M), 0.0, 1.0)
    limit = NARROW_MPS + (cruise_mps - NARROW_MPS) * width
    limit = np.minimum(limit, np.sqrt(LATERAL_MPS2 / np.maximum(_curvature(path.xy_m, arc_m), 1e-6)))
    limit[-1] = CREEP_MPS
    return np.sqrt(np.minimum.accumulate((limit**2 + 2 * BRAKE_MPS2 * arc_m)[::-1])[::-1] - 2 * BRAKE_MPS2 * arc_m)


def _curvature(xy_m: F64, arc_m: F64) -> F64:
    """Heading change per metre (n,) between the chords 1.5 m before and after each point."""
    last = len(arc_m) - 1
    before = xy_m - xy_m[np.maximum(np.searchsorted(arc_m, arc_m - 1.5), 0)]
    after = xy_m[np.minimum(np.searchsorted(arc_m, arc_m + 1.5), last)] - xy_m
    left, ahead = before[:, 0] * after[:, 1] - before[:, 1] * after[:, 0], np.sum(before * after, axis=1)
    turn = np.array([math.atan2(y, x) for y, x in zip(left, ahead, strict=True)])
    length = 0.5 * (np.hypot(*before.T) + np.hypot(*after.T))
    return np.where(length > 0.5, np.abs(turn) / np.maximum(length, 0.5), 0.0)
