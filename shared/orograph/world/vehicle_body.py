"""A vehicle as DART sees it: a box whose motion is given, which robots bump into and which nothing moves."""

from __future__ import annotations

import dartpy as dart
import numpy as np

from orograph.arrays import F64
from orograph.geometry import roll_pitch_yaw
from orograph.scenario import Vehicle
from orograph.scene.bodies import vehicle_box
from orograph.world.ground import isometry


class VehicleBody:
    """A kinematic box; its frame's origin is on the ground under the box's centre."""

    def __init__(self, name: str, vehicle: Vehicle) -> None:
        self.skeleton = dart.dynamics.Skeleton(name)
        self._joint, self.node = self.skeleton.createFreeJointAndBodyNodePair()
        self._joint.setActuatorType(dart.dynamics.VELOCITY)
        box = vehicle_box(vehicle)
        shape = self.node.createShapeNode(dart.dynamics.BoxShape(box[:3]))
        shape.setRelativeTranslation(box.centre_m)
        shape.createCollisionAspect()
        shape.createDynamicsAspect()
        self.R, self.position_m = np.eye(3), np.zeros(3)

    def place(self, R_map_vehicle: F64, position_m: F64) -> None:
        """Where it stands now."""
        self.R, self.position_m = R_map_vehicle, position_m
        self._joint.setTransform(isometry(R_map_vehicle, position_m))

    def move(self, R_map_vehicle: F64, position_m: F64, duration_s: float) -> None:
        """Set the speed that brings it there within a time, from where it was placed or moved to last."""
        self.place(self.R, self.position_m)
        turn_rad = np.array(roll_pitch_yaw(np.einsum("ij,kj->ik", R_map_vehicle, self.R)))
        path_m = position_m - self.position_m
        self.skeleton.setCommands(np.concatenate([turn_rad, path_m]) / duration_s)
        self.R, self.position_m = R_map_vehicle, position_m
