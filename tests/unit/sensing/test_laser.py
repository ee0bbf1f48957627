"""The laser's range images: closed forms on flat ground, bodies in the way, noise, dropouts and limits."""

from __future__ import annotations

import hashlib
import math
import os
import subprocess
import sys

import numpy as np
import pytest
from orograph.geometry import laser_position_m, quaternion, ray_directions, rotation
from orograph.messages import RANGE_UNIT_M
from orograph.points import points_from_ranges
from orograph.scene import build_scene
from orograph.sensing import Laser, RangeImager

EYE_M = 0.45
AHEAD = {"rings": 1, "columns": 8, "elevation_min_deg": 0.0, "elevation_max_deg": 0.0}
VEHICLE = {"loop": [[20, 20], [180, 20], [180, 180], [20, 180]], "size_m": [4.0, 2.0, 1.6]}


def laser_in(world, robot="robot_001") -> Laser:
    return Laser(world, robot, RangeImager(build_scene(world), world.laser))


def test_level_robot_on_flat_ground(flat_world, poses_at):
    world = flat_world()
    ranges = laser_in(world).scan(poses_at((100, 100, 0, 0.7), None, None), seed=1, frame=0)
    assert ranges.dtype == np.dtype("<u2")
    assert ranges.shape == (8, 36)
    for ring, elevation in enumerate(np.radians(np.linspace(-25, 25, 8))):
        expected = EYE_M / math.sin(-elevation) / RANGE_UNIT_M if elevation < 0 else 0
        # Half a step of quantisation, and float32's rounding at the half.
        np.testing.assert_allclose(ranges[ring], expected, atol=0.501, err_msg=f"ring {ring}")


def test_points_of_a_tilted_robot_lie_on_the_ground(flat_world, poses_at):
    world = flat_world(terrain={"slope_x": 0.2, "slope_y": -0.1})
    poses = poses_at((100, 100, 10.0, 0.0), None, None)
    R = rotation(0.15, -0.1, 2.0)
    poses["quaternion_wxyz"][0] = quaternion(R)
    ranges = laser_in(world).scan(poses, seed=1, frame=0)
    eye = laser_position_m(world.laser, R, poses["position_m"][0])
    points, _ = points_from_ranges(ranges, ray_directions(world.laser), R, eye)
    assert len(points) > 100
    np.testing.assert_allclose(points[:, 2], 0.2 * points[:, 0] - 0.1 * points[:, 1], atol=RANGE_UNIT_M)


def test_another_robot_is_seen_and_the_own_body_is_not(flat_world, poses_at):
    world = flat_world(laser={"rings": 1, "columns": 8, "elevation_min_deg": -3.0, "elevation_max_deg": -3.0})
    poses = poses_at((100, 100, 0, 0), (104, 100, 0, 0), None)
    first, second = (laser_in(world, f"robot_00{i}").scan(poses, 1, 0)[0] for i in (1, 2))
    ground_m = EYE_M / math.sin(math.radians(3))
    # The other's box is 0.72 m long: its near face stands 4 - 0.36 m away, for each of the two.
    face_m = (4 - 0.36) / math.cos(math.radians(3))
    for ranges, column in ((first, 0), (second, 4)):
        expected = np.full(8, ground_m)
        expected[column] = face_m
        np.testing.assert_allclose(ranges * RANGE_UNIT_M, expected, atol=0.0011)


def test_a_robots_box_reaches_from_its_clearance_to_its_height(flat_world, poses_at):
    world = flat_world(laser={"rings": 61, "columns": 8, "elevation_min_deg": -12.0, "elevation_max_deg": 0.0})
    ranges = laser_in(world).scan(poses_at((100, 100, 0, 0), (103, 100, 0, 0), None), 1, 0)[:, 0] * RANGE_UNIT_M
    elevation = np.radians(np.linspace(-12, 0, 61))
    face = ranges[np.abs(ranges * np.cos(elevation) - (3 - 0.36)) < 0.002]
    heights = EYE_M + np.sin(elevation[np.abs(ranges * np.cos(elevation) - (3 - 0.36)) < 0.002]) * face
    assert (heights.min(), heights.max()) == pytest.approx((0.75 * 0.11, 0.42), abs=0.012), (
        "one ring is 9 mm at that distance"
    )


def test_a_moved_body_is_seen_where_it_is_now(flat_world, poses_at):
    world = flat_world(laser=AHEAD, vehicles=[VEHICLE])
    laser = laser_in(world)
    for distance_m in (30.0, 20.0, 10.0):
        ranges = laser.scan(poses_at((100, 100, 0, 0), None, None, (100 + distance_m, 100, 0, 0)), 1, 0)
        assert ranges[0, 0] * RANGE_UNIT_M == pytest.approx(distance_m - 2.0, abs=0.0011)


def test_a_vehicle_hides_what_stands_behind_it(flat_world, poses_at):
    wall = {"footprint": [[130, 50], [135, 50], [135, 150], [130, 150]], "height_m": 10}
    world = flat_world(laser=AHEAD, vehicles=[VEHICLE], buildings=[wall])
    laser = laser_in(world)
    seen = {
        "hidden": laser.scan(poses_at((100, 100, 0, 0), None, None, (115, 100, 0, math.pi / 2)), 1, 0)[0, 0],
        "beside": laser.scan(poses_at((100, 100, 0, 0), None, None, (115, 105, 0, 0)), 1, 0)[0, 0],
        "behind": laser.scan(poses_at((100, 100, 0, 0), None, None, (145, 100, 0, 0)), 1, 0)[0, 0],
    }
    assert {name: round(r * RANGE_UNIT_M, 3) for name, r in seen.items()} == {
        "hidden": 14.0,
        "beside": 30.0,
        "behind": 30.0,
    }


def test_absent_bodies_are_neither_seen_nor_see(flat_world, poses_at):
    world = flat_world(laser=AHEAD, vehicles=[VEHICLE])
    poses = poses_at((100, 100, 0, 0), (104, 100, 0, 0), None, (110, 100, 0, 0))
    poses["present"][1] = poses["present"][3] = 0
    assert laser_in(world).scan(poses, 1, 0)[0, 0] == 0
    assert laser_in(world, "robot_002").scan(poses, 1, 0) is None
    assert laser_in(world, "robot_003").scan(poses_at((100, 100, 0, 0), (90, 100, 0, 0), None), 1, 0) is None


def test_nothing_returns_from_beyond_the_limits(flat_world, poses_at):
    wall = {"footprint": [[150, 50], [155, 50], [155, 150], [150, 150]], "height_m": 10}
    limits = {**AHEAD, "range_min_m": 5.0, "range_max_m": 40.0}
    laser = laser_in(flat_world(laser=limits, buildings=[wall]))
    returned = {
        x: int(laser.scan(poses_at((x, 100, 0, 0), None, None), 1, 0)[0, 0]) for x in (109.0, 110.5, 144.0, 146.0)
    }
    assert returned == {109.0: 0, 110.5: 19750, 144.0: 3000, 146.0: 0}


def test_measured_ranges_stay_below_the_maximum_in_float32(flat_world, poses_at):
    wall = {"footprint": [[150, 50], [155, 50], [155, 150], [150, 150]], "height_m": 100}
    world = flat_world(laser={"rings": 1, "columns": 4096, "elevation_min_deg": 0, "elevation_max_deg": 0,
                              "range_max_m": 40.0, "noise_m": 0.05}, buildings=[wall])  # fmt: skip
    ranges = laser_in(world).scan(poses_at((110.01, 100, 0, 0), None, None), 1, 0)
    in_metres = ranges.astype(np.float32) * np.float32(RANGE_UNIT_M)
    assert in_metres.max() > 39.9
    assert in_metres.max() < 40.0


@pytest.mark.parametrize("range_max_m", [80.0, 33.3])
def test_no_noise_makes_a_return_of_nothing(flat_world, poses_at, range_max_m):
    sky = {"elevation_min_deg": 1.0, "elevation_max_deg": 60.0, "noise_m": 0.5, "range_max_m": range_max_m}
    assert not laser_in(flat_world(laser=sky)).scan(poses_at((100, 100, 0, 0), None, None), 1, 0).any()


def test_noise_and_dropouts_have_their_size(flat_world, poses_at):
    spec = {"rings": 64, "columns": 4096, "elevation_min_deg": -10, "elevation_max_deg": -5, "noise_m": 0.03}
    quiet = laser_in(flat_world(laser=spec | {"noise_m": 0.0}))
    noisy = laser_in(flat_world(laser=spec | {"dropout": 0.05}))
    poses = poses_at((100, 100, 0, 0), None, None)
    true, measured = quiet.scan(poses, 7, 3).reshape(-1), noisy.scan(poses, 7, 3).reshape(-1)
    assert true.all()
    count = true.size
    # Four standard errors of a share and of a standard deviation, seed 7.
    assert (measured == 0).mean() == pytest.approx(0.05, abs=4 * math.sqrt(0.05 * 0.95 / count))
    error = (measured[measured > 0].astype(float) - true[measured > 0]) * RANGE_UNIT_M
    assert error.mean() == pytest.approx(0.0, abs=4 * 0.03 / math.sqrt(count))
    # Two quantisations add RANGE_UNIT_M^2 / 12 each to the variance; 4096 slices take 0.1 % from sigma.
    assert error.std() == pytest.approx(math.sqrt(0.03**2 + RANGE_UNIT_M**2 / 6), rel=4 / math.sqrt(2 * count) + 2e-3)
    within = (np.abs(error) < 0.029).mean()  # a bound between two steps, near one sigma
    assert within == pytest.approx(math.erf(0.029 / 0.03 / math.sqrt(2)), abs=0.005), "the shape is normal"


def noisy_city(flat_world):
    blocks = [
        {"footprint": [[x, y], [x + 12, y], [x + 12, y + 9], [x, y + 9]], "height_m": 5}
        for x in (80, 110)
        for y in (80, 110)
    ]
    waves = [{"amplitude_m": 1.5, "wavelength_m": 90, "heading_deg": 40}]
    return flat_world(laser={"noise_m": 0.02, "dropout": 0.02, "rings": 16, "columns": 180}, buildings=blocks,
                      terrain={"waves": waves}, vehicles=[VEHICLE])  # fmt: skip


def digest_of(world, poses) -> str:
    laser = laser_in(world, "robot_002")
    return hashlib.blake2b(b"".join(laser.scan(poses, 5, k).tobytes() for k in (0, 4, 8))).hexdigest()


def test_depends_on_seed_robot_and_frame_only(flat_world, poses_at):
    world = noisy_city(flat_world)
    poses = poses_at((101, 100, 1.2, 0), (101, 100, 1.2, 0), None, (105, 96, 1.2, 1.0))
    one = laser_in(world)
    first = one.scan(poses, 5, 4)
    one.scan(poses, 5, 8)
    np.testing.assert_array_equal(one.scan(poses, 5, 4), first)
    assert not np.array_equal(one.scan(poses, 5, 8), first)
    assert not np.array_equal(one.scan(poses, 6, 4), first)
    assert not np.array_equal(laser_in(world, "robot_002").scan(poses, 5, 4), first)


CHILD = """
import sys, numpy as np
from orograph.messages import POSE
from orograph.scenario import Scenario
import hashlib
from orograph.scene import build_scene
from orograph.sensing import Laser, RangeImager
world = Scenario.model_validate_json(sys.argv[1])
laser = Laser(world, "robot_002", RangeImager(build_scene(world), world.laser))
poses = np.frombuffer(bytes.fromhex(sys.argv[2]), POSE)
print(hashlib.blake2b(b"".join(laser.scan(poses, 5, k).tobytes() for k in (0, 4, 8))).hexdigest())
"""


def test_another_process_gets_the_same_ranges(flat_world, poses_at):
    world = noisy_city(flat_world)
    poses = poses_at((90, 104, 1.2, 0), (101, 100, 1.2, 2.1), None, (105, 96, 1.2, 1.0))
    command = [sys.executable, "-c", CHILD, world.model_dump_json(), poses.tobytes().hex()]
    environment = os.environ | {"PYTHONHASHSEED": "4242"}
    child = subprocess.run(command, capture_output=True, text=True, check=True, env=environment)
    assert child.stdout.strip() == digest_of(world, poses)
