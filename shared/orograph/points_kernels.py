"""Compiled: a range image to points."""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import njit


@njit(cache=True)
def place_points(
    ranges: Any, unit_m: float, directions: Any, R_map_robot: Any, position_m: Any, xyz: Any, ranges_m: Any
) -> None:
    """Set xyz (3, n) [m, map frame] and ranges_m (n,) of the n ranges (k,) that are not 0, in steps of `unit_m`.

    Unit directions (k, 3). Plain sums: the same bits on every host, unlike BLAS.
    """
    xx, xy, xz = R_map_robot[0]
    yx, yy, yz = R_map_robot[1]
    zx, zy, zz = R_map_robot[2]
    east, north, up = xyz[0], xyz[1], xyz[2]
    hits, n = np.empty(ranges.shape[0] + 1, np.uint32), np.uint64(0)
    for i in range(ranges.shape[0]):  # which rays return is hard to guess: better no branch
        hits[n] = i
        n += np.uint64(ranges[i] != 0)
    for k in range(ranges_m.shape[0]):
        i = hits[k]
        range_m = ranges[i] * unit_m
        x, y, z = directions[i, 0] * range_m, directions[i, 1] * range_m, directions[i, 2] * range_m
        east[k] = xx * x + xy * y + xz * z + position_m[0]
        north[k] = yx * x + yy * y + yz * z + position_m[1]
        up[k] = zx * x + zy * y + zz * z + position_m[2]
        ranges_m[k] = range_m
