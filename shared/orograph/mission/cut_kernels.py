"""Compiled: how far along one tour robots come that each drive a stretch of it."""

from __future__ import annotations

import numpy as np
from numba import njit

from orograph.arrays import F64, I64


@njit(cache=True)
def covered(from_m: F64, along_m: F64, limit_m: float) -> tuple[I64, I64]:
    """Of each set of robots (2 ** robots,), bit by bit: stops that it covers from the first on, and who drives last.

    `from_m` (robots, n) leads from each robot's place to each stop, `along_m` (n,) from the first stop to each. A robot
    drives one stretch from either end and, its way there included, no more than `limit_m`.
    """
    robots, n = from_m.shape
    reach, last = np.zeros(1 << robots, np.int64), np.full(1 << robots, -1, np.int64)
    for group in range(1, 1 << robots):
        for robot in range(robots):
            if not group >> robot & 1:
                continue
            begin = reach[group ^ (1 << robot)]
            end = begin
            for stop in range(begin, n):
                stretch_m = along_m[stop] - along_m[begin]
                if stretch_m + min(from_m[robot, begin], from_m[robot, stop]) <= limit_m:
                    end = stop + 1
            if end > reach[group] or last[group] < 0:
                reach[group], last[group] = end, robot
    return reach, last
