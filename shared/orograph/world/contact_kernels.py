"""Compiled: forces that push robots along the ground.

The spheres that stand for wheels are without friction in DART, so what its contacts do to a robot is to carry it,
straight up from the ground. A force along the ground comes from a wall, a vehicle or another robot.
"""

from __future__ import annotations

import math

from numba import njit

from orograph.arrays import F64
from orograph.world.tyre_kernels import axes_of


@njit(cache=True)
def feel(poses: F64, carried: F64, step_s: float, impulse: F64, newtons: F64) -> None:
    """Add one step's forces along the ground to `impulse` (n, 3) [N s]; keep the greatest in `newtons` (n,).

    Of n robots `poses` (n, 6) rotation vector and position, `carried` (n, 6) moment and force of DART's contacts.
    """
    for i in range(len(poses)):
        up = axes_of(poses[i, :3])[2]
        lift = up[0] * carried[i, 3] + up[1] * carried[i, 4] + up[2] * carried[i, 5]
        squared = 0.0
        for k in range(3):
            along = carried[i, 3 + k] - lift * up[k]
            impulse[i, k] += along * step_s
            squared += along * along
        newtons[i] = max(newtons[i], math.sqrt(squared))
