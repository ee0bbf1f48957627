"""The one place where points are made from ranges."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from orograph.arrays import F32, F64
from orograph.messages import RANGE_UNIT_M
from orograph.points_kernels import place_points


def points_from_ranges(
    ranges: npt.NDArray[Any], directions: F32, R_map_robot: F64, laser_position_m: npt.ArrayLike
) -> tuple[F64, F32]:
    """Collision points (n, 3) in the map frame and their measured distances (n,) [m] from one range image (u2).

    `laser_position_m` is the laser's origin in the map frame. No-returns (0) are left out. The points stand axis by
    axis in memory, as the mapping core reads them.
    """
    flat, position_m = np.ascontiguousarray(ranges).reshape(-1), np.asarray(laser_position_m, np.float64)
    count = np.count_nonzero(flat)
    xyz, ranges_m = np.empty((3, count)), np.empty(count, np.float32)
    rays, R = np.ascontiguousarray(directions).reshape(-1, 3), np.ascontiguousarray(R_map_robot)
    place_points(flat, RANGE_UNIT_M, rays, R, position_m, xyz, ranges_m)
    return xyz.T, ranges_m
