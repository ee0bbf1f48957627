"""One robot's laser: a range image of the scene and of every other body, with noise and dropouts."""

from __future__ import annotations

import math

import numpy as np
from scipy.special import ndtri

from orograph.arrays import F32, F64
from orograph.geometry import laser_position_m, ray_directions, rotation_from_quaternion
from orograph.keys import robot_number
from orograph.messages import RANGE_UNIT_M, Packed
from orograph.randomness import key
from orograph.scenario import LaserSpec, Scenario
from orograph.scene import Scene
from orograph.scene.site import Site
from orograph.sensing.bodies import Bodies, Boxes
from orograph.sensing.casting import RayCaster
from orograph.sensing.ray_kernels import range_image


def _noise_quantiles(sigma_m: float) -> F32:
    """Normal noise [m] (4096,) at the middles of equally likely slices: 12 bits pick one (up to 3.7 sigma)."""
    return np.asarray(sigma_m * ndtri((np.arange(4096) + 0.5) / 4096), np.float32)


class RangeImager:
    """Casts one range image's rays from a given pose and turns distances into ranges; some robots may share it."""

    def __init__(self, scene: Scene, laser: LaserSpec, robots: int = 1) -> None:
        self.directions = ray_directions(laser)
        self._rays = np.ascontiguousarray(self.directions.reshape(-1, 3).T)
        self._laser = laser
        self._caster = RayCaster(scene, laser.range_max_m, robots)
        self._noise_m = _noise_quantiles(laser.noise_m)
        self._last_unit = math.ceil(laser.range_max_m / RANGE_UNIT_M) - 1  # strictly below range_max_m in float32 too

    def image(self, R_map_robot: F64, position_m: F64, boxes: Boxes, noise: np.uint64) -> Packed:
        """Range image (rings, columns) u2 in RANGE_UNIT_M, 0 = no return; `noise` (64 bits) decides its draws."""
        laser = self._laser
        eye_m = laser_position_m(laser, R_map_robot, position_m)
        distances_m = self._caster.distances(eye_m, R_map_robot, self._rays, boxes)
        ranges = range_image(
            distances_m,
            noise,
            self._noise_m,
            laser.dropout,
            laser.range_min_m,
            self._last_unit,
            1 / RANGE_UNIT_M,
        )
        return ranges.reshape(laser.rings, laser.columns)


class Laser:
    """The laser on one robot of a scenario."""

    def __init__(self, scenario: Scenario, robot: str, imager: RangeImager) -> None:
        self._scenario, self._robot, self.imager = scenario, robot, imager
        self._own = robot_number(robot) - 1
        self._bodies = Bodies(scenario)

    def scan(self, poses: Packed, seed: int, frame: int) -> Packed | None:
        """Range image (rings, columns) u2 in RANGE_UNIT_M, 0 = no return; None while the robot itself is absent.

        `poses` (n,) POSE: robots by number, then vehicles. The robot's own body is not seen.
        """
        own = self._own
        if own >= len(poses) - len(self._scenario.vehicles) or not poses["present"][own]:
            return None
        R_map_robot = rotation_from_quaternion(poses["quaternion_wxyz"][own])
        boxes = self._bodies.boxes(poses, own, self._scenario.laser.range_max_m)
        noise = key(seed, "laser", self._robot, "noise", frame=frame)
        return self.imager.image(R_map_robot, poses["position_m"][own], boxes, noise)


class View:
    """What the lasers of one process look at: one imager for all, until the scene changes."""

    def __init__(self, site: Site, robots: int) -> None:
        self.scenario, self._site, self._robots = site.scenario, site, robots
        self._scene = site.scene()
        self._imager = RangeImager(self._scene, site.scenario.laser, robots)

    def imager(self, stamp_ns: int) -> RangeImager:
        """For the scene as it stands at a time."""
        scene = self._site.scene(stamp_ns)
        if scene is not self._scene:
            self._scene, self._imager = scene, RangeImager(scene, self.scenario.laser, self._robots)
        return self._imager
