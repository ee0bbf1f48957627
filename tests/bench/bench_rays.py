"""Rays per second of one laser on one core: scene, moving bodies, noise and quantisation included."""

from __future__ import annotations

import math
import time

import numpy as np
from orograph.geometry import quaternion, rotation
from orograph.messages import POSE, Packed
from orograph.randomness import stream
from orograph.scenario import Building, Scenario, Start, TerrainSpec, Vehicle, Wave
from orograph.scene import Scene, build_scene
from orograph.sensing import Laser

SCANS = 60


def town() -> Scenario:
    """A hilly square kilometre of blocks, three robots and two vehicles: the size of scenario `paper`."""
    draw = stream(0, "bench", "town")
    centres = [(x, y) for x in range(60, 960, 70) for y in range(60, 960, 70)]
    buildings = []
    for i, (x, y) in enumerate(centres):
        half_x, half_y, height = (float(v) for v in draw.uniform((8, 8, 4), (22, 22, 18)))
        corners = (
            (x - half_x, y - half_y),
            (x + half_x, y - half_y),
            (x + half_x, y + half_y),
            (x - half_x, y + half_y),
        )
        roof = ("flat", "gable", "hip")[i % 3]
        buildings.append(Building(footprint=corners, height_m=height, roof=roof, roof_height_m=2.0))  # type: ignore[arg-type]
    loop = ((95.0, 95.0), (165.0, 95.0), (165.0, 165.0), (95.0, 165.0))
    return Scenario(
        name="bench", title="Bench", base_station_m=(25, 25), patrol=((25, 25),), robots=3,
        starts=tuple(Start(x_m=25 + 5 * i, y_m=25) for i in range(3)), buildings=tuple(buildings),
        terrain=TerrainSpec(slope_x=0.01, waves=(Wave(amplitude_m=4, wavelength_m=300, heading_deg=30),)),
        vehicles=(Vehicle(loop=loop), Vehicle(loop=loop, start_fraction=0.5)),
    )  # fmt: skip


def poses_along_street(scenario: Scenario, scene: Scene, scan: int) -> Packed:
    """Three robots 4 m apart that drive a street at 3 m/s, two vehicles ahead."""
    x = 95.0 + 1.2 * scan + np.array([0.0, 4.0, 8.0, 20.0, 40.0])
    poses = np.zeros(len(x), POSE)
    poses["position_m"] = np.stack([x, np.full_like(x, 95.0), scene.height_m(x, 95.0)], axis=-1)
    poses["quaternion_wxyz"] = quaternion(rotation(0.01, -0.02, 0.05 * math.sin(scan)))
    poses["present"] = 1
    return poses


def figures() -> dict[str, float]:
    """`rays_per_s`: rays of one scan over the median processor time of a scan."""
    scenario = town()
    scene = build_scene(scenario)
    laser = Laser(scenario, "robot_001", scene)
    durations_s = []
    for scan in range(SCANS):
        poses = poses_along_street(scenario, scene, scan)
        begin = time.thread_time()
        ranges = laser.scan(poses, 1, scan)
        durations_s.append(time.thread_time() - begin)
        assert ranges is not None and np.count_nonzero(ranges) > 0.3 * ranges.size
    rays = scenario.laser.rings * scenario.laser.columns
    return {"rays_per_s": rays / float(np.median(durations_s))}


if __name__ == "__main__":
    print(figures())
