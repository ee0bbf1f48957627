"""Chooses places that lie far apart by road: a new scenario's waypoints and starts."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from orograph.mission.distances import UNREACHABLE_M

Metres = npt.NDArray[np.float64]


def reachable_together(distance_m: Metres) -> npt.NDArray[np.int64]:
    """Indices of the largest set of places (n, n road distances) that can all be reached from each other."""
    connected = distance_m < UNREACHABLE_M
    return np.flatnonzero(connected[int(np.argmax(connected.sum(axis=1)))])


def spread(distance_m: Metres, count: int, first: int) -> list[int]:
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
