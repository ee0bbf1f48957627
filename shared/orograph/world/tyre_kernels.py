"""The compiled step of all tyres; called through `world.tyres` only, where the model is described."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numba import njit

from orograph.arrays import F64

Number = Any
"""A float64; numba's typing leaves mypy no better word."""

DEFLECTION_X, DEFLECTION_Y, SPEED, ANGLE = 0, 1, 2, 3
"""Columns of a wheel's state [m, m, rad/s, rad]."""
LENGTH_X, WIDTH_Y, RADIUS, INERTIA, STIFFNESS, DAMPING, FRICTION, STEP = 0, 1, 2, 3, 4, 5, 6, 7
"""Of the constants: half wheelbase and half track [m], wheel radius [m], axle inertia [kg m^2], the tyre's stiffness
[N/m] and damping [N s/m], friction coefficient, time step [s]."""

SLIDING_ROUNDS, SLIDING_TOLERANCE = 20, 1e-3
"""Bounds of the search for a sliding wheel's force."""


@njit(cache=True)
def axes_of(turn_rad: F64) -> tuple[F64, F64, F64]:
    """A body's x, y, z axes in the map frame from its rotation vector (3,): the columns of Rodrigues' formula."""
    x, y, z = turn_rad[0], turn_rad[1], turn_rad[2]
    angle2 = x * x + y * y + z * z
    angle = math.sqrt(angle2)
    s = math.sin(angle) / angle if angle > 1e-9 else 1.0
    v = (1.0 - math.cos(angle)) / angle2 if angle > 1e-9 else 0.5
    c = 1.0 - v * angle2
    return (
        np.array((c + v * x * x, v * x * y + s * z, v * x * z - s * y)),
        np.array((v * x * y - s * z, c + v * y * y, v * y * z + s * x)),
        np.array((v * x * z + s * y, v * y * z - s * x, c + v * z * z)),
    )


@njit(cache=True)
def _along(axis: F64, row: F64, begin: int) -> Number:
    return axis[0] * row[begin] + axis[1] * row[begin + 1] + axis[2] * row[begin + 2]


@njit(cache=True)
def wheel_loads_n(lift_n: Number, roll_nm: Number, pitch_nm: Number, constants: F64) -> F64:
    """Loads (4,) of the wheels that make this force and these moments about the origin, none below 0."""
    by_roll, by_pitch = 0.25 * roll_nm / constants[WIDTH_Y], 0.25 * pitch_nm / constants[LENGTH_X]
    loads = np.empty(4)
    total = 0.0
    for w in range(4):
        by_place = (by_roll if w % 2 == 0 else -by_roll) - (by_pitch if w < 2 else -by_pitch)
        loads[w] = max(0.0, 0.25 * lift_n + by_place)
        total += loads[w]
    if total > 0.0:
        loads *= max(0.0, lift_n) / total
    return loads


@njit(cache=True)
def _roll(
    wheel: F64, torque_nm: Number, load_n: Number, along_mps: Number, across_mps: Number, constants: F64
) -> tuple[Number, Number]:
    """Step one wheel's state (4,) in place; returns the ground's force on it [N], ahead and to the left.

    Its spin is solved with the force it causes, for the rotor is light and the tyre stiff; a sliding foot's force is
    the sticking one's times the `share` that brings it down to friction times load.
    """
    radius, stiffness, step = constants[RADIUS], constants[STIFFNESS], constants[STEP]
    held = stiffness * step + constants[DAMPING]
    gain = step / constants[INERTIA]
    limit = constants[FRICTION] * load_n
    bent_x, force_y = stiffness * wheel[DEFLECTION_X], -stiffness * wheel[DEFLECTION_Y] - held * across_mps
    speed, force_x, share = wheel[SPEED], 0.0, 1.0
    for _ in range(SLIDING_ROUNDS):
        pushed = torque_nm + radius * share * (bent_x + held * along_mps)
        speed = (wheel[SPEED] + gain * pushed) / (1.0 + gain * radius * radius * share * held)
        force_x = -bent_x - held * (along_mps - radius * speed)
        size = math.sqrt(force_x * force_x + force_y * force_y)
        if share * size <= limit * (1.0 + SLIDING_TOLERANCE):
            break
        share = limit / size
    wheel[SPEED] = speed
    wheel[ANGLE] += step * speed
    if share < 1.0:
        wheel[DEFLECTION_X], wheel[DEFLECTION_Y] = -share * force_x / stiffness, -share * force_y / stiffness
    else:
        wheel[DEFLECTION_X] += step * (along_mps - radius * speed)
        wheel[DEFLECTION_Y] += step * across_mps
    return share * force_x, share * force_y


@njit(cache=True)
def roll_all(poses: F64, velocities: F64, carried: F64, torques_nm: F64, wheels: F64, constants: F64) -> F64:
    """Wrenches (n, 6) of the tyres on the bodies, moment then force, about their origins in the map frame's axes.

    `poses` (n, 6) rotation vector and position, `velocities` (n, 6) angular and linear, `carried` (n, 6) the wrench
    with which the ground carried the bodies in the step before, `torques_nm` (n, 4); `wheels` (n, 4, 4) is stepped.
    """
    wrenches = np.zeros((len(poses), 6))
    for i in range(len(poses)):
        ahead, left, up = axes_of(poses[i, :3])
        loads = wheel_loads_n(
            _along(up, carried[i], 3), _along(ahead, carried[i], 0), _along(left, carried[i], 0), constants
        )
        v_ahead, v_left, yaw_rate = (
            _along(ahead, velocities[i], 3),
            _along(left, velocities[i], 3),
            _along(up, velocities[i], 0),
        )
        fx, fy, pitch, yaw = 0.0, 0.0, 0.0, 0.0
        for w in range(4):
            x = constants[LENGTH_X] if w < 2 else -constants[LENGTH_X]
            y = constants[WIDTH_Y] if w % 2 == 0 else -constants[WIDTH_Y]
            force_x, force_y = _roll(
                wheels[i, w], torques_nm[i, w], loads[w], v_ahead - yaw_rate * y, v_left + yaw_rate * x, constants
            )
            fx += force_x
            fy += force_y
            yaw += x * force_y - y * force_x
            # The hub takes the force, the chassis the motor's counter-torque.
            pitch += constants[RADIUS] * force_x - torques_nm[i, w]
        for k in range(3):
            wrenches[i, k] = pitch * left[k] + yaw * up[k]
            wrenches[i, 3 + k] = fx * ahead[k] + fy * left[k]
    return wrenches
