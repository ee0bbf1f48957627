"""Compiled loop of large patrols: tours without crossings."""

from __future__ import annotations

from numba import njit

from orograph.arrays import F64, I64


@njit(cache=True)
def uncross(distance_m: F64, tour: I64, passes: int) -> None:
    """Shorten an open tour of places in place, its first fixed, by turning round any stretch for which that helps.

    Distances (n, n), the same both ways. All pairs are looked at, at most `passes` times (2-opt).
    """
    count = len(tour)
    for _ in range(passes):
        shorter = False
        for i in range(1, count - 1):
            for j in range(i + 1, count):
                before, first, last = tour[i - 1], tour[i], tour[j]
                gain_m = distance_m[before, first] - distance_m[before, last]
                if j + 1 < count:
                    gain_m += distance_m[last, tour[j + 1]] - distance_m[first, tour[j + 1]]
                if gain_m > 1e-6:
                    tour[i : j + 1] = tour[i : j + 1][::-1].copy()
                    shorter = True
        if not shorter:
            return
