"""Compiled loops of the laser: turning rays, and making a range image of distances."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt
from numba import njit

F32 = npt.NDArray[np.float32]


@njit(cache=True)
def turned(directions: F32, rotation: npt.NDArray[np.float64]) -> F32:
    """Directions (n, 3) turned by a rotation (3, 3); plain sums, so the same bits on every host, unlike BLAS."""
    out = np.empty_like(directions)
    for i in range(directions.shape[0]):
        x, y, z = np.float64(directions[i, 0]), np.float64(directions[i, 1]), np.float64(directions[i, 2])
        for k in range(3):
            out[i, k] = rotation[k, 0] * x + rotation[k, 1] * y + rotation[k, 2] * z
    return out


@njit(cache=True)
def range_image(
    distances_m: F32, noise_m: F32, chance: F32, dropout: float, range_min_m: float, last_unit: int, unit_m: float
) -> npt.NDArray[Any]:
    """Ranges (n,) u2 in steps of `unit_m`, 0 = no return, of true distances and their noise, both (n,) [m].

    A ray returns nothing where nothing is met, where `chance` in [0, 1) is below `dropout`, or where the measured
    distance lies below `range_min_m` or beyond `last_unit` steps.
    """
    out = np.zeros(distances_m.shape[0], np.uint16)
    for i in range(distances_m.shape[0]):
        measured_m = np.float64(distances_m[i]) + np.float64(noise_m[i])
        unit = np.floor(measured_m / unit_m + 0.5)
        if range_min_m <= measured_m and 1 <= unit <= last_unit and chance[i] >= dropout:
            out[i] = np.uint16(unit)
    return out
