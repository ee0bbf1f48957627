"""Bodies that move, robots and vehicles, as lasers and physics know them: their boxes, and how they stand."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from orograph.arrays import F64
from orograph.scenario import RobotSpec, Vehicle
from orograph.scene.model import Scene

CLEARANCE_OF_RADIUS = 0.75
"""Ground clearance under a robot's chassis as a share of the wheel radius."""
VEHICLE_CLEARANCE_M = 0.2
"""Under a vehicle, whose wheels nobody sees or touches."""

Vector = tuple[float, float, float]


class BodyBox(NamedTuple):
    """A box along the body's axes [m], `clearance_m` above its origin, which is on the ground under its centre."""

    length_m: float
    width_m: float
    height_m: float
    clearance_m: float

    @property
    def centre_m(self) -> Vector:
        """In the body's frame."""
        return 0.0, 0.0, self.clearance_m + 0.5 * self.height_m


def robot_box(spec: RobotSpec) -> BodyBox:
    """The chassis: from its clearance up to the robot's height."""
    return _on(CLEARANCE_OF_RADIUS * spec.wheel_radius_m, spec.size_m)


def vehicle_box(vehicle: Vehicle) -> BodyBox:
    """The bodywork: from its clearance up to the vehicle's height."""
    return _on(VEHICLE_CLEARANCE_M, vehicle.size_m)


def _on(clearance_m: float, size_m: Vector) -> BodyBox:
    length_m, width_m, height_m = size_m
    clearance_m = min(clearance_m, 0.5 * height_m)
    return BodyBox(length_m, width_m, height_m - clearance_m, clearance_m)


def standing_robot(scene: Scene, x_m: float, y_m: float, yaw_rad: float) -> tuple[F64, F64]:
    """(R_map_robot (3, 3), position (3,)) of a robot that stands still on the ground, upright to its wheels."""
    spec = scene.scenario.robot
    R_map_robot = standing_rotation(scene, x_m, y_m, yaw_rad, (spec.wheelbase_m, spec.track_m))
    return R_map_robot, np.array([x_m, y_m, float(scene.height_m(x_m, y_m))])


def standing_rotation(scene: Scene, x_m: float, y_m: float, yaw_rad: float, size_m: tuple[float, float]) -> F64:
    """R_map_body (3, 3) of a body of length and width `size_m` that stands on the ground with this heading."""
    half_length, half_width = 0.5 * size_m[0], 0.5 * size_m[1]
    c, s = math.cos(yaw_rad), math.sin(yaw_rad)
    x_places = x_m + np.array([c * half_length, -c * half_length, -s * half_width, s * half_width])
    y_places = y_m + np.array([s * half_length, -s * half_length, c * half_width, -c * half_width])
    ahead, behind, left, right = scene.height_m(x_places, y_places).tolist()
    rise, climb = (ahead - behind) / size_m[0], (left - right) / size_m[1]
    x_length, z_length = math.sqrt(1 + rise * rise), math.sqrt(1 + rise * rise + climb * climb)
    x_axis = c / x_length, s / x_length, rise / x_length
    # (c, s, rise) x (-s, c, climb)
    z_axis = (s * climb - c * rise) / z_length, (-s * rise - c * climb) / z_length, 1 / z_length
    return np.array([x_axis, _cross(z_axis, x_axis), z_axis]).T


def _cross(a: Vector, b: Vector) -> Vector:
    """`np.cross` of two plain vectors, which costs fifty times as much."""
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]
