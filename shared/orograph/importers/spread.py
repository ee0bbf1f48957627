"""Chooses places that lie far apart by road: a new scenario's waypoints and starts."""

from __future__ import annotations

import numpy as np

from orograph.arrays import F64, I64
from orograph.mission.distances import UNREACHABLE_M


def reachable_together(distance_m: F64) -> I64:
    """Indices of the largest set of places (n, n road distances) that can all be reached from each other."""
    connected = distance_m < UNREACHABLE_M
    return np.flatnonzero(connected[int(np.argmax(connected.sum(axis=1)))])


def spread(distance_m: F64, count: int, first: int) -> list[int]:
    """Up to `count` indices, beginning with `first`, each the farthest by road from all before it."""
    chosen = [first]
    nearest = distance_m[first].copy()
    while len(chosen) < min(count, len(distance_m)):
        farthest = int(np.argmax(nearest))
        if nearest[farthest] <= 0:
            break
        chosen.append(farthest)
        nearest = np.minimum(nearest, distance_m[farthest])
    return chosen
