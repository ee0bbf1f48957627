"""Tyres of all robots at once: Coulomb friction between wheels and ground through a little elasticity (Dahl's model).

A tyre's foot sticks to the ground and the tyre bends until its force reaches friction times load; then the foot slides
against the slip. So a robot stands still on a slope, and a skid-steer turns by real slip, equal in all directions. The
load is what DART's contacts carried in the step before, shared among the wheels by least squares, as four wheels on a
rigid body leave it open. Friction among DART's own contacts would be the dearest part of the whole simulation: its
exact solver took half of a step.
"""

from __future__ import annotations

import numpy as np

from orograph.arrays import F64
from orograph.scenario import RobotSpec
from orograph.world.robot_body import AXLE_INERTIA_KGM2
from orograph.world.tyre_kernels import ANGLE, SPEED, roll_all

TYRE_FRICTION = 0.8
"""Rubber on dry asphalt."""
BODY_TURNOVER_S = 0.023
"""Time constant of the body on its four bent tyres, 1/sqrt(stiffness / mass): some steps of 5 ms, a few mm."""
DAMPING_SHARE = 0.7
"""Of critical."""


class Tyres:
    """Bend, speed and angle of the wheels of n robots."""

    def __init__(self, spec: RobotSpec, robots: int, step_s: float) -> None:
        stiffness_npm = 0.25 * spec.mass_kg / BODY_TURNOVER_S**2
        damping_nspm = 0.25 * spec.mass_kg * 2 * DAMPING_SHARE / BODY_TURNOVER_S
        place_m = 0.5 * spec.wheelbase_m, 0.5 * spec.track_m, spec.wheel_radius_m
        friction = stiffness_npm, damping_nspm, TYRE_FRICTION
        self._constants = np.array([*place_m, AXLE_INERTIA_KGM2, *friction, step_s])
        self._wheels = np.zeros((robots, 4, 4))

    @property
    def speeds_radps(self) -> F64:
        """Of the wheels (n, 4)."""
        return self._wheels[:, :, SPEED]

    @property
    def angles_rad(self) -> F64:
        """Turned by the wheels (n, 4) since the beginning."""
        return self._wheels[:, :, ANGLE]

    def halt(self, robot: int) -> None:
        """One robot's wheels stand, unbent."""
        self._wheels[robot, :, :ANGLE] = 0.0

    def step(self, poses: F64, velocities: F64, carried: F64, torques_nm: F64) -> F64:
        """Wrenches (n, 6) on the robots for the next step; DART's generalised coordinates of free joints (n, 6)."""
        return roll_all(poses, velocities, carried, torques_nm, self._wheels, self._constants)
