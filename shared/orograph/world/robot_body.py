"""One skid-steer robot as a DART skeleton: one rigid body, a box on four spheres.

A wheel touches the ground as a sphere: one contact, no edge to catch on the mesh, and without friction in DART: the
spin of the wheels and their grip on the ground are `tyres.py`.
"""

from __future__ import annotations

from collections.abc import Sequence

import dartpy as dart
import numpy as np
import numpy.typing as npt

from orograph.arrays import F64
from orograph.scenario import RobotSpec
from orograph.scene.bodies import robot_box
from orograph.world.ground import isometry

WHEEL_FRICTION = 0.0
CHASSIS_FRICTION = 0.3
WHEEL_MASS_SHARE = 0.03
AXLE_INERTIA_KGM2 = 0.05
"""Of one wheel about its axle, its motor's rotor as seen through the gear included."""
WHEELS = ((1, 1), (1, -1), (-1, 1), (-1, -1))
"""Order of the wheels, as signs of (x, y): front left, front right, rear left, rear right."""


class RobotBody:
    """A robot's skeleton; its frame's origin is on the ground under the body's centre."""

    def __init__(self, name: str, spec: RobotSpec) -> None:
        self.skeleton = dart.dynamics.Skeleton(name)
        self._joint, self._chassis = self.skeleton.createFreeJointAndBodyNodePair()
        self._add_chassis(spec)
        for hub_m in _hubs_m(spec):
            self._add_shape(dart.dynamics.SphereShape(spec.wheel_radius_m), hub_m, WHEEL_FRICTION)

    def place(self, R_map_robot: F64, position_m: npt.ArrayLike) -> None:
        """Put it there, at rest."""
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

    def _add_chassis(self, spec: RobotSpec) -> None:
        chassis = robot_box(spec)
        box = dart.dynamics.BoxShape(chassis[:3])
        self._add_shape(box, chassis.centre_m, CHASSIS_FRICTION)
        # Batteries and motors sit low: a third up the box.
        box_com_m, box_kg = chassis.clearance_m + chassis.height_m / 3, spec.mass_kg * (1 - 4 * WHEEL_MASS_SHARE)
        com_m = (box_kg * box_com_m + (spec.mass_kg - box_kg) * spec.wheel_radius_m) / spec.mass_kg
        moment_kgm2 = box.computeInertiaFromMass(box_kg) + _of_points(
            [box_kg] + 4 * [WHEEL_MASS_SHARE * spec.mass_kg],
            [np.array([0.0, 0.0, box_com_m - com_m])] + [hub - [0.0, 0.0, com_m] for hub in _hubs_m(spec)],
        )
        self._chassis.setInertia(_inertia(spec.mass_kg, moment_kgm2, np.array([0.0, 0.0, com_m])))

    def _add_shape(self, shape: dart.dynamics.Shape, centre_m: npt.ArrayLike, friction: float) -> None:
        node = self._chassis.createShapeNode(shape)
        node.setRelativeTranslation(centre_m)
        node.createCollisionAspect()
        node.createDynamicsAspect().setFrictionCoeff(friction)


def _hubs_m(spec: RobotSpec) -> list[F64]:
    """Centres (3,) of the wheels."""
    return [np.array([0.5 * x * spec.wheelbase_m, 0.5 * y * spec.track_m, spec.wheel_radius_m]) for x, y in WHEELS]


def _of_points(masses_kg: Sequence[float], places_m: Sequence[F64]) -> F64:
    """Moment of inertia (3, 3) of point masses about the origin."""
    total = np.zeros((3, 3))
    for mass_kg, place_m in zip(masses_kg, places_m, strict=True):
        total += mass_kg * ((place_m * place_m).sum() * np.eye(3) - np.outer(place_m, place_m))
    return total


def _inertia(mass_kg: float, moment_kgm2: F64, centre_of_mass_m: F64) -> dart.dynamics.Inertia:
    inertia = dart.dynamics.Inertia()
    inertia.setMass(mass_kg)
    inertia.setLocalCOM(centre_of_mass_m)
    inertia.setMoment(moment_kgm2)
    return inertia
