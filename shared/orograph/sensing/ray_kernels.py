"""Compiled loops of the laser: turning rays, boxes against rays, and making a range image of distances."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from numba import njit

from orograph.arrays import F32, F64

BLOCK = 480
"""Rays that draw together, so that their words stay near the core."""


@njit(cache=True, error_model="numpy")
def turn(directions: F32, rotation: F64, rays: F32) -> None:
    """Set `rays` (3, n) to unit directions (3, n) turned by (3, 3). Plain sums: the same bits on every host."""
    for i in range(directions.shape[1]):
        a, b, c = np.float64(directions[0, i]), np.float64(directions[1, i]), np.float64(directions[2, i])
        rays[0, i] = rotation[0, 0] * a + rotation[0, 1] * b + rotation[0, 2] * c
        rays[1, i] = rotation[1, 0] * a + rotation[1, 1] * b + rotation[1, 2] * c
        rays[2, i] = rotation[2, 0] * a + rotation[2, 1] * b + rotation[2, 2] * c


@njit(cache=True, error_model="numpy")
def meet_boxes(rays: F32, offsets_m: F64, half_m: F64, R_box_map: F64, reach_m: float, away_m: F64) -> None:
    """Shorten `away_m` (n,) in place to where rays (3, n) from the origin enter boxes (slab method).

    Boxes: centres (k, 3) relative to the rays' origin, half sizes (k, 3), R_box_map (k, 3, 3). One that holds the
    origin is met where the ray leaves it.
    """
    count = rays.shape[1]
    near = np.empty(count, np.bool_)
    for k in range(offsets_m.shape[0]):
        cx, cy, cz = offsets_m[k, 0], offsets_m[k, 1], offsets_m[k, 2]
        outside = cx * cx + cy * cy + cz * cz
        for axis in range(3):
            outside -= half_m[k, axis] * half_m[k, axis]
        for i in range(count):  # all others pass beside the box's bounding sphere
            along = rays[0, i] * cx + rays[1, i] * cy + rays[2, i] * cz
            near[i] = (outside <= 0) | ((along > 0) & (along * along >= outside))
        for i in range(count):
            if not near[i]:
                continue
            enter, leave = -np.inf, np.inf
            for axis in range(3):
                a, b, c = R_box_map[k, axis, 0], R_box_map[k, axis, 1], R_box_map[k, axis, 2]
                speed = a * rays[0, i] + b * rays[1, i] + c * rays[2, i]
                centre = a * cx + b * cy + c * cz
                if speed == 0.0:
                    enter = np.inf if abs(centre) > half_m[k, axis] else enter
                    continue
                one, other = (centre - half_m[k, axis]) / speed, (centre + half_m[k, axis]) / speed
                enter, leave = max(enter, min(one, other)), min(leave, max(one, other))
            met = enter if enter > 0 else leave
            if enter <= leave and 0 < met < min(away_m[i], reach_m):
                away_m[i] = met


@njit(cache=True, error_model="numpy")
def range_image(
    distances_m: F64,
    key: np.uint64,
    noise_m: F32,
    dropout: float,
    range_min_m: float,
    last_unit: int,
    units_per_m: float,
) -> npt.NDArray[np.uint16]:
    """Ranges (n,) u2 in steps, 0 = no return, of distances (n,) [m]; nothing returns nearer or farther than the limits.

    Each ray has a word of `_draw`: its highest 12 bits pick the noise from `noise_m` (4096,), its lowest 16 drop the
    ray if below `dropout` of their values.
    """
    count, dropped_below = distances_m.shape[0], np.uint64(dropout * 65536)
    out, words, measured_m = np.empty(count, np.uint16), np.empty(BLOCK, np.uint64), np.empty(BLOCK)
    for begin in range(0, count, BLOCK):
        size = min(BLOCK, count - begin)
        _draw(key, begin, words)
        for i in range(size):  # each loop on its own, and no branch: so they run in vector registers
            measured_m[i] = distances_m[begin + i] + noise_m[words[i] >> np.uint64(52)]
        for i in range(size):
            unit = measured_m[i] * units_per_m + 0.5
            kept = (words[i] & np.uint64(0xFFFF)) >= dropped_below
            returns = kept & (measured_m[i] >= range_min_m) & (unit >= 1) & (unit < last_unit + 1.0)
            out[begin + i] = np.uint16(np.int32(unit if returns else 0.0))
    return out


@njit(cache=True, error_model="numpy")
def _draw(key: np.uint64, begin: int, words: npt.NDArray[np.uint64]) -> None:
    """Set random words (n,): SplitMix64's (Steele et al. 2014) from number `begin` on, which wait for no other."""
    for i in range(words.shape[0]):
        word = key + np.uint64(begin + i + 1) * np.uint64(0x9E3779B97F4A7C15)
        word = (word ^ (word >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
        word = (word ^ (word >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
        words[i] = word ^ (word >> np.uint64(31))
