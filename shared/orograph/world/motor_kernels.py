"""The compiled step of all servos; called through `world.motors` only, where the laws are described."""

from __future__ import annotations

import numpy as np
from numba import njit

from orograph.arrays import F64


@njit(cache=True)
def ramp(set_speed: F64, wanted: F64, change: F64) -> None:
    """Bring the set body speeds (n, 2) towards the wanted (n, 2) by at most `change` (2,), in place."""
    for i in range(len(set_speed)):
        for k in range(2):
            set_speed[i, k] += min(max(wanted[i, k] - set_speed[i, k], -change[k]), change[k])


@njit(cache=True)
def servo_torques_nm(
    set_speed: F64,
    wheels_of_body: F64,
    speeds_radps: F64,
    integral_radps: F64,
    gain: float,
    limit_nm: float,
    share: float,
) -> F64:
    """Torques (n, 4) within the limit; the integral parts (n, 4) grow by `share` of the error where it is not met."""
    torques = np.empty(speeds_radps.shape)
    for i in range(len(torques)):
        for w in range(4):
            wanted = set_speed[i, 0] * wheels_of_body[0, w] + set_speed[i, 1] * wheels_of_body[1, w]
            error = wanted - speeds_radps[i, w]
            asked = gain * (error + integral_radps[i, w])
            torques[i, w] = min(max(asked, -limit_nm), limit_nm)
            if asked == torques[i, w]:
                integral_radps[i, w] += error * share
    return torques
