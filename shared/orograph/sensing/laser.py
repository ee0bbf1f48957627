"""One robot's laser: a range image of the scene and of every other body, with noise and dropouts."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from orograph.geometry import ray_directions, rotation_from_quaternion
from orograph.keys import robot_number
from orograph.messages import RANGE_UNIT_M, Packed
from orograph.randomness import stream
from orograph.scenario import LaserSpec, Scenario
from orograph.scene import Mesh, Scene
from orograph.sensing.bodies import body_boxes
from orograph.sensing.casting import RayCaster
from orograph.sensing.kernels import range_image, turned

F32 = npt.NDArray[np.float32]
F64 = npt.NDArray[np.float64]


def laser_position_m(laser: LaserSpec, R_map_robot: F64, position_m: F64) -> F64:
    """Origin of the rays in the map frame: straight above the robot's own origin."""
    return np.asarray(position_m + R_map_robot[:, 2] * laser.height_above_base_m, np.float64)


class RangeCamera:
    """Casts one range image's rays from a given pose and turns distances into ranges."""

    def __init__(self, scene: Scene, laser: LaserSpec) -> None:
        self.directions = ray_directions(laser)
        self._rays = np.ascontiguousarray(self.directions.reshape(-1, 3))
        self._laser = laser
        self._caster = RayCaster(scene, laser.range_max_m)
        self._last_unit = math.ceil(laser.range_max_m / RANGE_UNIT_M) - 1  # strictly below range_max_m in float32 too

    def distances(self, R_map_robot: F64, position_m: F64, boxes: Mesh) -> F32:
        """True distances (rings * columns,) [m], range_max_m where nothing is met."""
        origin_m = laser_position_m(self._laser, R_map_robot, position_m)
        return self._caster.distances(origin_m, turned(self._rays, R_map_robot), boxes)

    def ranges(self, distances_m: F32, noise_m: F32, chance: F32, dropout: float) -> Packed:
        """Range image (rings, columns) u2 in RANGE_UNIT_M of distances, noise [m] and chances in [0, 1), all (n,)."""
        image = range_image(
            distances_m, noise_m, chance, dropout, self._laser.range_min_m, self._last_unit, RANGE_UNIT_M
        )
        return image.reshape(self._laser.rings, self._laser.columns)


class Laser:
    """The laser on one robot of a scenario."""

    def __init__(self, scenario: Scenario, robot: str, scene: Scene) -> None:
        self._scenario, self._robot = scenario, robot
        self._own = robot_number(robot) - 1
        self._camera = RangeCamera(scene, scenario.laser)

    def scan(self, poses: Packed, seed: int, frame: int) -> Packed | None:
        """Range image (rings, columns) u2 in RANGE_UNIT_M, 0 = no return; None while the robot itself is absent.

        `poses` (n,) POSE: robots by number, then vehicles. The robot's own body is not seen.
        """
        if self._own >= len(poses) - len(self._scenario.vehicles) or not poses["present"][self._own]:
            return None
        position_m = poses["position_m"][self._own]
        R_map_robot = rotation_from_quaternion(poses["quaternion_wxyz"][self._own])
        laser = self._scenario.laser
        boxes = body_boxes(self._scenario, poses, self._own, position_m, laser.range_max_m)
        distances_m = self._camera.distances(R_map_robot, position_m, boxes)
        draws = stream(seed, "laser", self._robot, "noise", frame=frame)
        noise_m = draws.standard_normal(len(distances_m), np.float32) * np.float32(laser.noise_m)
        chance = draws.random(len(distances_m), np.float32)
        return self._camera.ranges(distances_m, noise_m, chance, laser.dropout)
