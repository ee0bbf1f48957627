"""Compiled: a scan's points from a sensor that moves, into the map frame."""

from __future__ import annotations

import math
from typing import Any

from numba import njit


@njit(cache=True)
def place(
    points: Any, point_ns: Any, knot_ns: int, R: Any, p: Any, box: Any, R_base_sensor: Any, p_base_sensor: Any,
    xyz: Any, ranges_m: Any,
) -> int:  # fmt: skip
    """Points (n, 3) of the sensor into xyz (3, n) of the map, with their ranges; returns how many stayed.

    Rotations R (k, 3, 3) and places p (k, 3) are of the times 0, `knot_ns`, 2 `knot_ns`, ...; between two of them both
    change evenly. `point_ns` (n,) or (0,) where all are of the first. Left out is what lies in `box` (x0, y0, z0, x1,
    y1, z1) of the base frame; (0,) for no box.
    """
    kept, moving, boxed = 0, point_ns.shape[0] > 0, box.shape[0] > 0
    for i in range(points.shape[0]):
        x, y, z = float(points[i, 0]), float(points[i, 1]), float(points[i, 2])
        if boxed:
            A, b = R_base_sensor, p_base_sensor
            bx = A[0, 0] * x + A[0, 1] * y + A[0, 2] * z + b[0]
            by = A[1, 0] * x + A[1, 1] * y + A[1, 2] * z + b[1]
            bz = A[2, 0] * x + A[2, 1] * y + A[2, 2] * z + b[2]
            if box[0] <= bx <= box[3] and box[1] <= by <= box[4] and box[2] <= bz <= box[5]:
                continue
        share, k = 0.0, 0
        if moving:
            share = min(max(point_ns[i] / knot_ns, 0.0), R.shape[0] - 1.0)
            k = min(int(share), R.shape[0] - 2)
            share -= k
        for axis in range(3):
            at = R[k, axis, 0] * x + R[k, axis, 1] * y + R[k, axis, 2] * z + p[k, axis]
            if share > 0.0:
                later = R[k + 1, axis, 0] * x + R[k + 1, axis, 1] * y + R[k + 1, axis, 2] * z + p[k + 1, axis]
                at += share * (later - at)
            xyz[axis, kept] = at
        ranges_m[kept] = math.sqrt(x * x + y * y + z * z)
        kept += 1
    return kept
