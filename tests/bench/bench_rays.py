"""Rays per second of one laser on one core, on `paper`, beside embreex, which casts the same rays and does no more."""

from __future__ import annotations

import time

import numpy as np
import numpy.typing as npt
from embreex.mesh_construction import TriangleMesh
from embreex.rtcore import EmbreeDevice
from embreex.rtcore_scene import EmbreeScene
from orograph.geometry import laser_position_m, quaternion, ray_directions, rotation, rotation_from_quaternion
from orograph.messages import POSE, Packed
from orograph.scenario import Scenario
from orograph.scene import Scene, build_scene
from orograph.scene.mesh import joined
from orograph.sensing import Laser, RangeImager
from orograph.sensing.casting import TILE_M
from orograph.storage.scenario_file import load_scenario

SCANS, TURN = 200, 10
STEP_M = 1.2
"""Between two scans at 3 m/s and 2.5 Hz."""


def along_patrol(scenario: Scenario, distances_m: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
    """Places (n, 2) on the line through the patrol's waypoints."""
    corners = np.array(scenario.patrol)
    at_m = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(corners, axis=0).T))])
    return np.stack([np.interp(distances_m, at_m, corners[:, axis]) for axis in (0, 1)], axis=-1)


def poses_of(scenario: Scenario, scene: Scene, scan: int) -> Packed:
    """Three robots 6 m apart on the patrol, nodding a little, and every vehicle on its loop."""
    robots = along_patrol(scenario, scan * STEP_M + 6.0 * np.arange(3))
    vehicles = [scene.vehicle_pose(i, 2.0 * scan) for i in range(len(scenario.vehicles))]
    poses = np.zeros(len(robots) + len(vehicles), POSE)
    poses["position_m"][:3] = np.c_[robots, scene.height_m(*robots.T)]
    poses["quaternion_wxyz"][:3] = quaternion(rotation(0.01, -0.02, 0.1 * np.sin(scan)))
    for pose, (x, y, z, yaw) in zip(poses[3:], vehicles, strict=True):
        pose["position_m"], pose["quaternion_wxyz"] = (x, y, z), quaternion(rotation(0, 0, yaw))
    poses["present"] = 1
    return poses


class Direct:
    """embreex called directly, robust as ours: the rays of a pose, turned beforehand, and nothing but the scene."""

    def __init__(self, scenario: Scenario, scene: Scene) -> None:
        self._laser, self._device, self._scene = scenario.laser, EmbreeDevice(), scene
        self._directions = ray_directions(scenario.laser).reshape(-1, 3).astype(np.float64)
        self._windows: dict[tuple[int, int], EmbreeScene] = {}

    def cast(self, pose: Packed) -> float:
        """Processor seconds of one call."""
        tile = tuple((pose["position_m"][:2] // TILE_M).astype(int).tolist())
        origin_m = np.array([*((np.array(tile) + 0.5) * TILE_M), 0.0])
        if tile not in self._windows:
            west, south = origin_m[:2] - TILE_M / 2 - self._laser.range_max_m
            east, north = origin_m[:2] + TILE_M / 2 + self._laser.range_max_m
            mesh = joined(self._scene.meshes_in((west, south, east, north)))
            self._windows[tile] = EmbreeScene(self._device, robust=True)
            TriangleMesh(self._windows[tile], (mesh.vertices - origin_m).astype(np.float32), mesh.faces)
        R_map_robot = rotation_from_quaternion(pose["quaternion_wxyz"])
        rays = np.ascontiguousarray(self._directions @ R_map_robot.T, np.float32)
        eye_m = laser_position_m(self._laser, R_map_robot, pose["position_m"]) - origin_m
        origins, distances = np.tile(eye_m.astype(np.float32), (len(rays), 1)), np.full(len(rays), 80.0, np.float32)
        begin = time.thread_time()
        self._windows[tile].run(origins, rays, dists=distances, query="DISTANCE")
        return time.thread_time() - begin


def figures() -> dict[str, float]:
    """`rays_per_s` with noise and bodies, by the median processor time of a scan, and `rays_ratio` to embreex's."""
    scenario = load_scenario("scenarios/paper")
    scene = build_scene(scenario)
    laser, direct = Laser(scenario, "robot_001", RangeImager(scene, scenario.laser)), Direct(scenario, scene)
    ours_s, embreex_s = [], []
    for first in range(0, SCANS, TURN):  # in turns, so that what else this machine does slows both
        poses = [poses_of(scenario, scene, scan) for scan in range(first, first + TURN)]
        embreex_s += [direct.cast(there[0]) for there in poses]
        for scan, there in enumerate(poses, first):
            begin = time.thread_time()
            ranges = laser.scan(there, scenario.seed, scan)
            ours_s.append(time.thread_time() - begin)
            assert ranges is not None and np.count_nonzero(ranges) > 0.3 * ranges.size
    ours, embreex = float(np.median(ours_s)), float(np.median(embreex_s))
    return {"rays_per_s": scenario.laser.rings * scenario.laser.columns / ours, "rays_ratio": embreex / ours}


if __name__ == "__main__":
    print(figures())
