"""The library's door: what readers of recorded scans give becomes what the rules take, or is refused in words.

The simulation's own scans come through typed messages and skip it. Coordinates are those of the map frame [m].
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import numpy.typing as npt

from orograph.arrays import F64, Mask

RANGE_MIN_M = 1.0
"""What comes back from nearer is no surface: rays without a return at the sensor's own place, the robot's own body."""
FLOAT32_STEP_MAX_M = 2e-3
"""Coarsest step of float32 coordinates that is taken: as fine as the ranges of the simulated laser."""
HEIGHT_POINTS, HEIGHT_OFF_M = 100, 0.05
"""So many points, and ranges that agree with a height to this much, tell the laser's height."""
CLOCK_BACK_NS = 1_000_000_000
"""A stamp that lies further back than this is of a clock that was set back; a nearer one came late."""
TICK_MAX = 2**32 - 1
"""Ticks are milliseconds in 32 bits: 49 days from the first scan on."""


def checked_points(points: npt.ArrayLike) -> npt.NDArray[Any]:
    """Points (n, 3) [m, map frame] from (n, >= 3) or an organised cloud (h, w, >= 3); further columns are left out.

    Raises ValueError for other shapes and types, and for float32 too far from zero to hold them.
    """
    array = np.asarray(points)
    if array.size == 0:
        return np.zeros((0, 3))
    if array.dtype.kind not in "fiu":
        raise ValueError(f"points: expected numbers (n, 3) [m], found {array.dtype}; pick the fields x, y, z")
    if array.ndim not in (2, 3) or array.shape[-1] < 3:
        raise ValueError(f"points: expected (n, 3) or more columns [m, map frame], found {array.shape}")
    flat = array.reshape(-1, array.shape[-1])[:, :3]
    if flat.dtype == np.float32:
        far_m = np.float32(np.max(np.abs(flat), initial=0.0, where=np.isfinite(flat)))
        if (step_m := float(np.spacing(far_m))) > FLOAT32_STEP_MAX_M:
            raise ValueError(
                f"points: float32 holds steps of {step_m:g} m at {far_m:.0f} m: give float64, or shift the map's origin"
            )
        return flat
    return np.asarray(flat, np.float64)


def checked_ranges(ranges_m: npt.ArrayLike, count: int) -> F64:
    """Ranges (n,) [m], one for each of `count` points, from (n,), (n, 1) or (h, w); raises ValueError."""
    array = np.asarray(ranges_m)
    if array.size == 0 and count == 0:
        return np.zeros(0)
    if array.dtype.kind not in "fiu" or array.size != count:
        raise ValueError(
            f"ranges_m: expected one number for each of {count} points [m], found {array.shape} of {array.dtype}"
        )
    return np.ascontiguousarray(array.reshape(-1), np.float64)


def near(ranges_m: F64, range_min_m: float) -> Mask:
    """Which of ranges (n,) [m] are no measurement of a surface: at or below 0, or below the smallest range."""
    return (ranges_m <= 0) | (ranges_m < range_min_m)


def beyond(points: npt.NDArray[Any], ranges_m: F64, range_min_m: float) -> tuple[npt.NDArray[Any], F64, int]:
    """Points (n, 3) and ranges (n,) without those that are `near`, and how many these were; no copy where none is."""
    dropped = near(ranges_m, range_min_m)
    count = int(np.count_nonzero(dropped))
    return (points[~dropped], ranges_m[~dropped], count) if count else (points, ranges_m, 0)


def checked_position(position_xy_m: npt.ArrayLike) -> tuple[float, float]:
    """The robot's (x, y) [m, map frame]; raises ValueError for what is no place."""
    array = np.asarray(position_xy_m, np.float64).reshape(-1)
    if len(array) < 2 or not np.isfinite(array[:2]).all():
        raise ValueError(f"position_xy_m: expected finite (x, y) [m, map frame], found {array.tolist()}")
    return float(array[0]), float(array[1])


def laser_height_m(points: npt.NDArray[Any], ranges_m: F64, x_m: float, y_m: float) -> float:
    """The laser's z [m] from its x, y and the ranges (n,) of points (n, 3); NaN where these do not tell it.

    (z - laser's z)^2 is what the range leaves beside the way across, so a line through these squares gives it; on flat
    ground, where the points' z hardly differ, the laser is as far above it.
    """
    known = np.isfinite(points).all(axis=1) & np.isfinite(ranges_m)
    x, y, z = np.asarray(points[known], np.float64).T
    ranges, across_m = ranges_m[known], np.hypot(x - x_m, y - y_m)
    left = ranges**2 - across_m**2
    if len(z) < HEIGHT_POINTS:
        return math.nan
    middle = z - z.mean()
    candidates = [float(np.median(z + np.sqrt(np.maximum(left, 0.0))))]
    if middle.any():
        candidates.append(float(-(middle * (left - z**2)).sum() / (2.0 * (middle * middle).sum())))
    off_m, height_m = min((float(np.median(np.abs(np.hypot(across_m, z - h) - ranges))), h) for h in candidates)
    return height_m if off_m < HEIGHT_OFF_M else math.nan


def positive(name: str, value: float) -> float:
    """The number, finite and above 0; raises ValueError."""
    if not (math.isfinite(value) and value > 0):
        raise ValueError(f"{name}: expected a finite number above 0, found {value}")
    return value


class ScanClock:
    """Ticks [ms] of scans by any clock that counts nanoseconds: only differences of stamps enter the rules.

    Simulation time stays as it is. Another clock (Unix, GPS, negative) counts from its first stamp. A clock that was
    set back is counted, and as much time is taken to have passed: what was seen before may have changed since. A stamp
    that merely came late keeps its own.
    """

    def __init__(self) -> None:
        self._zero_ns: int | None = None
        self._newest_ns = 0
        self.restarts = 0

    def tick(self, stamp_ns: int) -> int:
        """The tick of a scan; raises ValueError for a stamp beyond what ticks can count."""
        stamp_ns = int(stamp_ns)
        if self._zero_ns is None:
            self._zero_ns = 0 if 0 <= stamp_ns < TICK_MAX // 2 * 1_000_000 else stamp_ns
            self._newest_ns = stamp_ns
        elif stamp_ns < self._newest_ns - CLOCK_BACK_NS:
            self._zero_ns -= 2 * (self._newest_ns - stamp_ns)
            self._newest_ns = stamp_ns
            self.restarts += 1
        self._newest_ns = max(self._newest_ns, stamp_ns)
        tick = max(0, (stamp_ns - self._zero_ns) // 1_000_000)
        if tick > TICK_MAX:
            raise ValueError(f"stamp_ns: {stamp_ns} lies more than 49 days after the first scan; begin a new map")
        return tick
