"""One skid-steer robot as a DART skeleton: a box on four wheels, each with a motor of its own.

A wheel touches the ground as a sphere: one contact, no edge to catch on the mesh. Friction is Coulomb's, equal in
all directions, so the robot turns by slipping sideways, as a skid-steer does.
"""

from __future__ import annotations

import dartpy as dart
import numpy as np
import numpy.typing as npt

from orograph.scenario import RobotSpec
from orograph.world.ground import isometry

F64 = npt.NDArray[np.float64]

WHEEL_FRICTION = 0.8
"""Rubber on dry asphalt."""
CHASSIS_FRICTION = 0.3
WHEEL_MASS_SHARE = 0.03
CLEARANCE_OF_RADIUS = 0.75
"""Ground clearance under the chassis as a share of the wheel radius."""
AXLE_INERTIA_KGM2 = 0.05
"""Of one wheel about its axle, its motor's rotor as seen through the gear included."""
FREE_DOFS = 6
WHEELS = ((1, 1), (1, -1), (-1, 1), (-1, -1))
"""Order of the wheels, as signs of (x, y): front left, front right, rear left, rear right."""


class RobotBody:
    """A robot's skeleton; its frame's origin is on the ground under the body's centre."""

    def __init__(self, name: str, spec: RobotSpec) -> None:
        self.skeleton = dart.dynamics.Skeleton(name)
        self._joint, self._chassis = self.skeleton.createFreeJointAndBodyNodePair()
        self._add_chassis(spec)
        for signs in WHEELS:
            self._add_wheel(spec, signs)

    def place(self, R_map_robot: F64, position_m: npt.ArrayLike) -> None:
        """Put it there, at rest, wheels unturned."""
        self.skeleton.resetPositions()
        self._joint.setTransform(isometry(R_map_robot, position_m))
        self.halt()

    def halt(self) -> None:
        """Take all motion away."""
        self.skeleton.resetVelocities()
        self.skeleton.resetCommands()

    def rotation(self) -> F64:
        """R_map_robot (3, 3)."""
        return np.array(self._chassis.getWorldTransform().rotation())

    def position_m(self) -> F64:
        """Origin (3,) in the map frame."""
        return np.array(self._chassis.getWorldTransform().translation())

    def velocity_mps(self) -> F64:
        """Velocity (3,) of the origin in the map frame."""
        return np.array(self._chassis.getLinearVelocity())

    def wheel_angles_rad(self) -> F64:
        """Turned angles (4,) of the wheels since the robot was placed."""
        return np.array(self.skeleton.getPositions()[FREE_DOFS:])

    def _add_chassis(self, spec: RobotSpec) -> None:
        length, width, height = spec.size_m
        clearance = CLEARANCE_OF_RADIUS * spec.wheel_radius_m
        box = dart.dynamics.BoxShape([length, width, height - clearance])
        centre_m = np.array([0.0, 0.0, 0.5 * (clearance + height)])
        mass_kg = spec.mass_kg * (1 - 4 * WHEEL_MASS_SHARE)
        # Batteries and motors sit low: a third up the box.
        centre_of_mass_m = np.array([0.0, 0.0, clearance + (height - clearance) / 3])
        self._chassis.setInertia(_inertia(mass_kg, box.computeInertiaFromMass(mass_kg), centre_of_mass_m))
        node = self._chassis.createShapeNode(box)
        node.setRelativeTranslation(centre_m)
        node.createCollisionAspect()
        node.createDynamicsAspect().setFrictionCoeff(CHASSIS_FRICTION)

    def _add_wheel(self, spec: RobotSpec, signs: tuple[int, int]) -> None:
        joint, wheel = self.skeleton.createRevoluteJointAndBodyNodePair(self._chassis)
        hub_m = (0.5 * signs[0] * spec.wheelbase_m, 0.5 * signs[1] * spec.track_m, spec.wheel_radius_m)
        joint.setTransformFromParentBodyNode(isometry(np.eye(3), hub_m))
        joint.setAxis([0.0, 1.0, 0.0])
        sphere = dart.dynamics.SphereShape(spec.wheel_radius_m)
        moment_kgm2 = np.diag([0.5, 1.0, 0.5]) * AXLE_INERTIA_KGM2
        wheel.setInertia(_inertia(WHEEL_MASS_SHARE * spec.mass_kg, moment_kgm2, np.zeros(3)))
        node = wheel.createShapeNode(sphere)
        node.createCollisionAspect()
        node.createDynamicsAspect().setFrictionCoeff(WHEEL_FRICTION)


def _inertia(mass_kg: float, moment_kgm2: F64, centre_of_mass_m: F64) -> dart.dynamics.Inertia:
    inertia = dart.dynamics.Inertia()
    inertia.setMass(mass_kg)
    inertia.setLocalCOM(centre_of_mass_m)
    inertia.setMoment(moment_kgm2)
    return inertia
