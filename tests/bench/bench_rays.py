"""Rays per second of one laser on one core, on `paper`: scene, moving bodies, noise and quantisation included."""

from __future__ import annotations

import time

import numpy as np
import numpy.typing as npt
from orograph.geometry import quaternion, rotation
from orograph.messages import POSE, Packed
from orograph.scenario import Scenario
from orograph.scene import Scene, build_scene
from orograph.sensing import Laser
from orograph.storage.scenario_file import load_scenario

SCANS = 200
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


def figures() -> dict[str, float]:
    """`rays_per_s`: rays of one scan over the median processor time of a scan."""
    scenario = load_scenario("scenarios/paper")
    scene = build_scene(scenario)
    laser = Laser(scenario, "robot_001", scene)
    durations_s = []
    for scan in range(SCANS):
        poses = poses_of(scenario, scene, scan)
        begin = time.thread_time()
        ranges = laser.scan(poses, scenario.seed, scan)
        durations_s.append(time.thread_time() - begin)
        assert ranges is not None and np.count_nonzero(ranges) > 0.3 * ranges.size
    rays = scenario.laser.rings * scenario.laser.columns
    return {"rays_per_s": rays / float(np.median(durations_s))}


if __name__ == "__main__":
    print(figures())
