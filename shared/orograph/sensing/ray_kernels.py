"""Compiled loops of the laser: arranging rays, boxes against rays, and making a range image of distances."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt
from numba import njit

from orograph.arrays import F32, F64, I32


@njit(cache=True)
def split_by_slope(
    directions: F32, rotation: F64, steepest: float, origin: F64, rays: F32, origins: F32, places: I32
) -> int:
    """Set `rays` (n, 3) to unit directions turned by (3, 3), each with its `origins` row and place in `directions`.

    Rays that rise more steeply than `steepest` [m/m] come last; returns how many come first. Plain sums: the same bits
    on every host, unlike BLAS.
    """
    first, last = np.uint64(0), np.uint64(directions.shape[0])
    for i in range(directions.shape[0]):
        a, b, c = np.float64(directions[i, 0]), np.float64(directions[i, 1]), np.float64(directions[i, 2])
        x = rotation[0, 0] * a + rotation[0, 1] * b + rotation[0, 2] * c
        y = rotation[1, 0] * a + rotation[1, 1] * b + rotation[1, 2] * c
        z = rotation[2, 0] * a + rotation[2, 1] * b + rotation[2, 2] * c
        if z > 0 and z * z > steepest * steepest * (x * x + y * y):
            last -= np.uint64(1)
            k = last
        else:
            k = first
            first += np.uint64(1)
        rays[k, 0], rays[k, 1], rays[k, 2] = x, y, z
        origins[i, 0], origins[i, 1], origins[i, 2] = origin[0], origin[1], origin[2]
        places[k] = i
    return int(first)


@njit(cache=True)
def nearest_box_hits(rays: F32, distances_m: F32, centres_m: F64, half_m: F64, R_box_map: F64) -> None:
    """Shorten `distances_m` (n,) in place to where rays (n, 3) from the origin enter boxes (slab method).

    Boxes: centres (k, 3) relative to the rays' origin, half sizes (k, 3), R_box_map (k, 3, 3). A box that holds the
    origin is met where the ray leaves it.
    """
    for k in range(centres_m.shape[0]):
        cx, cy, cz = centres_m[k]
        outside = cx * cx + cy * cy + cz * cz - np.sum(half_m[k] ** 2)
        for i in range(rays.shape[0]):
            x, y, z = np.float64(rays[i, 0]), np.float64(rays[i, 1]), np.float64(rays[i, 2])
            along = x * cx + y * cy + z * cz
            if outside > 0 and (along <= 0 or along * along < outside):
                continue  # passes beside the box's bounding sphere
            enter, leave = -np.inf, np.inf
            for axis in range(3):
                r = R_box_map[k, axis]
                speed = r[0] * x + r[1] * y + r[2] * z
                centre = r[0] * cx + r[1] * cy + r[2] * cz
                if speed == 0.0:
                    if abs(centre) > half_m[k, axis]:
                        enter = np.inf
                    continue
                one, other = (centre - half_m[k, axis]) / speed, (centre + half_m[k, axis]) / speed
                enter, leave = max(enter, min(one, other)), min(leave, max(one, other))
            met = enter if enter > 0 else leave
            if enter <= leave and 0 < met < distances_m[i]:
                distances_m[i] = met


@njit(cache=True)
def drop_beyond(distances_m: F32, reach_m: float) -> None:
    """Set distances (n,) that are not below the reach to infinity, in place."""
    end = np.float32(reach_m)
    for i in range(distances_m.shape[0]):
        distances_m[i] = distances_m[i] if distances_m[i] < end else np.float32(np.inf)


@njit(cache=True)
def range_image(
    distances_m: F32, places: I32, draws: npt.NDArray[np.uint16], noise_m: F32, dropout: float, range_min_m: float,
    last_unit: int, units_per_m: float,
) -> npt.NDArray[Any]:  # fmt: skip
    """Ranges (n,) u2 in steps, 0 = no return; ray i's distance goes to place `places[i]`.

    `draws` (2, n) are even over the 65 536 values of a u2: the first picks the ray's noise from `noise_m` (4096,),
    the second drops it if below `dropout` of them. Nothing returns below `range_min_m` or beyond `last_unit` steps.
    """
    dropped_below = dropout * 65536
    out = np.empty(distances_m.shape[0], np.uint16)
    for i in range(distances_m.shape[0]):  # without a branch, for noise makes near ends hard to guess
        place = np.uint32(places[i])
        measured_m = np.float64(distances_m[i]) + np.float64(noise_m[draws[0, place] >> 4])
        unit = np.floor(measured_m * units_per_m + 0.5)
        returns = (measured_m >= range_min_m) & (unit >= 1) & (unit <= last_unit) & (draws[1, place] >= dropped_below)
        out[place] = np.uint16(np.int32(unit if returns else 0.0))
    return out
