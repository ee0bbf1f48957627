"""Chooses places that lie far apart by road: a new scenario's waypoints and starts."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from orograph.arrays import F64


def spread(distances_m: Callable[[int, float], F64], count: int, first: int) -> tuple[list[int], float]:
    """Up to `count` indices, beginning with `first`, each the farthest by road from all before it; and a net's length.

    The net [m] joins each place to the nearest of those before it. `distances_m(i, within)` gives the road distances
    (n,) [m] from place i, anything large beyond `within`: once places lie dense, only their surroundings are searched.
    """
    chosen, net_m = [first], 0.0
    nearest = distances_m(first, math.inf)
    while len(chosen) < count:
        farthest = int(np.argmax(nearest))
        if (apart_m := float(nearest[farthest])) <= 0:
            break
        chosen.append(farthest)
        net_m += apart_m
        nearest = np.minimum(nearest, distances_m(farthest, apart_m))
    return chosen, net_m
