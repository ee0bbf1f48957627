"""Physics: robots stand, drive, turn, climb, hold and bump as they should; the same drives give the same bits."""

from __future__ import annotations

import hashlib
import io
import json
import math
import os
import subprocess
import sys
from collections.abc import Callable, Mapping
from pathlib import Path

import numpy as np
import pytest
import trimesh
from orograph.geometry import roll_pitch_yaw, rotation_from_quaternion
from orograph.scenario import Building, Change, Scenario, Start, TerrainSpec, Vehicle, Wave
from orograph.scene import build_scene
from orograph.world import World
from orograph.world.ground import _binary_ply, ground_skeleton

ROBOT = "robot_001"
FRAME_NS = 100_000_000
Make = Callable[..., Scenario]


def run(world: World, seconds: float, drives: Mapping[str, tuple[float, float]]) -> float:
    """Drive for a while; returns the turned yaw of the first robot [rad]."""
    turned, yaw = 0.0, roll_pitch_yaw(world.rotation(world.robots[0]))[2]
    for _ in range(round(seconds * 1e9 / FRAME_NS)):
        world.advance(drives, FRAME_NS)
        before, yaw = yaw, roll_pitch_yaw(world.rotation(world.robots[0]))[2]
        turned += (yaw - before + math.pi) % (2 * math.pi) - math.pi
    return turned


def test_stands_on_flat_ground_where_it_starts(scenario_of: Make) -> None:
    world = World(scenario_of(terrain=TerrainSpec(height_m=7.0)), (ROBOT,))
    run(world, 1.0, {})
    assert world.position_m(ROBOT) == pytest.approx([50, 50, 7.0], abs=0.01)
    assert world.rotation(ROBOT) == pytest.approx(np.eye(3), abs=0.01)


def test_stands_in_a_hollow(scenario_of: Make) -> None:
    """DART takes a bowl for a convex body: inside its hull a robot finds no ground and falls."""
    hollow = tuple(Wave(amplitude_m=5, wavelength_m=600, heading_deg=h, phase_deg=240) for h in (0, 90))
    scenario = scenario_of(terrain=TerrainSpec(waves=hollow))
    world = World(scenario, (ROBOT,))
    run(world, 0.5, {})
    assert world.position_m(ROBOT)[2] == pytest.approx(float(world.scene.height_m(50, 50)), abs=0.03)


def test_drives_straight_at_the_wanted_speed(scenario_of: Make) -> None:
    world = World(scenario_of(), (ROBOT,))
    run(world, 1.5, {ROBOT: (2.0, 0.0)})
    before = world.position_m(ROBOT)
    turned = run(world, 2.0, {ROBOT: (2.0, 0.0)})
    assert world.position_m(ROBOT) - before == pytest.approx([4.0, 0.0, 0.0], abs=0.05)
    assert turned == pytest.approx(0.0, abs=0.02)
    assert world.speed_mps(ROBOT) == pytest.approx(2.0, abs=0.05)
    assert world.wheel_odometry(ROBOT) == pytest.approx((2.0, 0.0), abs=0.02)


def test_keeps_its_acceleration_limit_and_stops_without_a_drive(scenario_of: Make) -> None:
    world = World(scenario_of(), (ROBOT,))
    run(world, 0.5, {ROBOT: (3.0, 0.0)})
    assert 0.7 < world.speed_mps(ROBOT) < 1.05  # 2 m/s^2 for 0.5 s
    run(world, 1.0, {})
    assert world.speed_mps(ROBOT) == pytest.approx(0.0, abs=0.01)


@pytest.mark.parametrize("heading_deg", [0.0, 30.0])
def test_turns_on_the_spot_by_slipping(scenario_of: Make, heading_deg: float) -> None:
    world = World(scenario_of(starts=(Start(x_m=50, y_m=50, heading_deg=heading_deg),)), (ROBOT,))
    run(world, 1.0, {ROBOT: (0.0, 1.0)})
    turned = run(world, 3.0, {ROBOT: (0.0, 1.0)})
    assert turned == pytest.approx(3.0, rel=0.12)
    assert np.linalg.norm(world.position_m(ROBOT)[:2] - 50) < 0.2
    assert world.wheel_odometry(ROBOT)[1] == pytest.approx(1.0, abs=0.02)


def test_slip_is_real_on_a_slope(scenario_of: Make) -> None:
    """Across a slope, turning slides the robot downhill, and the wheels do not know."""
    world = World(scenario_of(terrain=TerrainSpec(slope_y=0.3)), (ROBOT,))
    run(world, 0.5, {})
    before = world.position_m(ROBOT)
    run(world, 4.0, {ROBOT: (0.0, 1.0)})
    assert world.position_m(ROBOT)[1] - before[1] < -0.1
    assert world.wheel_odometry(ROBOT)[0] == pytest.approx(0.0, abs=0.05)


@pytest.mark.parametrize("heading_deg", [0.0, 90.0, 180.0])
def test_holds_and_climbs_the_steepest_passable_slope(scenario_of: Make, heading_deg: float) -> None:
    start = Start(x_m=50, y_m=50, heading_deg=heading_deg)
    world = World(scenario_of(terrain=TerrainSpec(slope_x=0.3), starts=(start,)), (ROBOT,))
    run(world, 1.0, {})
    held = world.position_m(ROBOT)
    run(world, 5.0, {})
    assert np.linalg.norm(world.position_m(ROBOT) - held) < 0.02
    run(world, 3.0, {ROBOT: (1.0, 0.0)})
    assert world.speed_mps(ROBOT) == pytest.approx(1.0, abs=0.08)
    assert world.rotation(ROBOT)[2, 2] == pytest.approx(1 / math.hypot(1, 0.3), abs=0.02)  # wheels on the ground


def test_hard_driving_does_not_tip_it(scenario_of: Make) -> None:
    scenario = scenario_of(terrain=TerrainSpec(slope_x=0.2, waves=(Wave(amplitude_m=0.5, wavelength_m=25),)))
    world = World(scenario, (ROBOT,))
    upright = []
    for drive in ((3.0, 2.0), (-3.0, -2.0), (3.0, -2.0), (3.0, 0.0), (-3.0, 2.0)):
        for _ in range(10):
            world.advance({ROBOT: drive}, FRAME_NS)
            upright.append(world.rotation(ROBOT)[2, 2])
    assert min(upright) > math.cos(math.radians(40))


def test_a_wall_stops_it(scenario_of: Make) -> None:
    wall = Building(footprint=((54, 40), (60, 40), (60, 60), (54, 60)), height_m=5)
    world = World(scenario_of(buildings=(wall,)), (ROBOT,))
    run(world, 6.0, {ROBOT: (1.0, 0.0)})
    assert world.position_m(ROBOT)[0] == pytest.approx(54 - 0.36, abs=0.12)
    assert world.wheel_odometry(ROBOT)[0] > 0.5  # its wheels spin on


def test_weak_motors_cannot_climb(scenario_of: Make) -> None:
    """0.3 slope asks for about 5 N m per wheel."""
    scenario = scenario_of(terrain=TerrainSpec(slope_x=0.3))
    weak = scenario.model_copy(update={"robot": scenario.robot.model_copy(update={"wheel_torque_max_nm": 3.0})})
    world = World(weak, (ROBOT,))
    run(world, 3.0, {ROBOT: (1.0, 0.0)})
    assert world.position_m(ROBOT)[0] < 50


LOOP = ((20.0, 50.0), (90.0, 50.0), (90.0, 90.0), (20.0, 90.0))


def test_vehicle_waits_for_a_robot_that_cannot_push_through_it(scenario_of: Make) -> None:
    scenario = scenario_of(
        vehicles=(Vehicle(loop=LOOP, speed_mps=6.0),), starts=(Start(x_m=50, y_m=50, heading_deg=180),)
    )
    world = World(scenario, (ROBOT,))
    run(world, 8.0, {})
    waiting_x = world.vehicle_poses()[0, 0]
    assert 50 - 0.36 - 2.1 - 5 < waiting_x < 50 - 0.36 - 2.1 - 1
    run(world, 8.0, {ROBOT: (1.0, 0.0)})
    assert world.vehicle_poses()[0, 0] == pytest.approx(waiting_x, abs=0.05)
    nose_to_nose = world.position_m(ROBOT)[0] - world.vehicle_poses()[0, 0] - 0.36 - 2.1
    assert nose_to_nose > -0.05


def test_vehicle_s_body_follows_its_loop(scenario_of: Make) -> None:
    """DART integrates the body's given speed; it must be where its pose says when each frame ends."""
    world = World(
        scenario_of(vehicles=(Vehicle(loop=LOOP, speed_mps=5.0),), terrain=TerrainSpec(slope_x=0.1)), (ROBOT,)
    )
    for _ in range(120):
        world.advance({}, FRAME_NS)
        pose = world.poses()[1]
        body = world._physics.getSkeleton("vehicle_000").getBodyNode(0).getWorldTransform()
        assert body.translation() == pytest.approx(pose["position_m"], abs=0.02)
        assert body.rotation() == pytest.approx(rotation_from_quaternion(pose["quaternion_wxyz"]), abs=0.02)
    assert world.vehicle_poses()[0] == pytest.approx([43.6, 50, 0], abs=0.1)  # round the corner and down the street


def test_robots_come_and_go(scenario_of: Make) -> None:
    starts = (Start(x_m=50, y_m=50), Start(x_m=50, y_m=60))
    world = World(scenario_of(starts=starts), (ROBOT, "robot_002"))
    run(world, 1.0, {ROBOT: (1.0, 0.0)})
    world.remove_robot(ROBOT)
    gone_at = world.position_m(ROBOT)
    assert list(world.poses()["present"]) == [0, 1]
    run(world, 1.0, {ROBOT: (1.0, 0.0), "robot_002": (1.0, 0.0)})
    assert (world.position_m(ROBOT) == gone_at).all()
    world.add_robot(ROBOT)
    run(world, 1.5, {ROBOT: (1.0, 0.0)})
    assert world.position_m(ROBOT)[0] > gone_at[0] + 0.8
    assert list(world.poses()["present"]) == [1, 1]


def test_robot_without_a_start_is_refused(scenario_of: Make) -> None:
    with pytest.raises(ValueError, match="robot_002 has no start"):
        World(scenario_of(), (ROBOT, "robot_002"))


def test_the_grounds_file_is_the_mesh_as_trimesh_reads_it(scenario_of: Make) -> None:
    mesh = build_scene(scenario_of(terrain=TerrainSpec(slope_x=0.2, mesh_cell_m=20.0))).mesh
    read = trimesh.load(io.BytesIO(_binary_ply(mesh)), file_type="ply", process=False)
    np.testing.assert_array_equal(read.vertices, mesh.vertices.astype(np.float32))
    np.testing.assert_array_equal(read.faces, mesh.faces)


def test_ground_is_one_immobile_body(scenario_of: Make) -> None:
    skeleton = ground_skeleton(World(scenario_of(), (ROBOT,)).scene.mesh)
    assert not skeleton.isMobile() and skeleton.getNumBodyNodes() == 1


def _mission_digest(scenario: Scenario) -> str:
    world = World(scenario, (ROBOT, "robot_002"))
    seen = hashlib.blake2b(digest_size=16)
    for k in range(40):
        world.advance({ROBOT: (2.0, math.sin(k / 5)), "robot_002": (1.5, -0.4)}, FRAME_NS)
        seen.update(world.poses().tobytes() + np.array(world.wheel_odometry(ROBOT)).tobytes())
    return seen.hexdigest()


def test_same_drives_same_bits_in_any_process(scenario_of: Make) -> None:
    scenario = scenario_of(
        terrain=TerrainSpec(
            waves=(Wave(amplitude_m=1, wavelength_m=30), Wave(amplitude_m=1, wavelength_m=40, heading_deg=90))
        ),
        buildings=(Building(footprint=((52, 52), (60, 52), (60, 60), (52, 60)), height_m=5),),
        vehicles=(Vehicle(loop=LOOP), Vehicle(loop=LOOP, start_fraction=0.3)),
        starts=(Start(x_m=50, y_m=50), Start(x_m=51, y_m=51, heading_deg=200)),
    )
    here = [_mission_digest(scenario), _mission_digest(scenario)]
    program = (
        "import sys, json; from orograph.scenario import Scenario; "
        f"sys.path.insert(0, {str(Path(__file__).parent)!r}); import test_world; "
        "print(test_world._mission_digest(Scenario.model_validate(json.load(sys.stdin))))"
    )
    for hash_seed in ("1", "77"):
        done = subprocess.run(
            [sys.executable, "-c", program], input=json.dumps(scenario.model_dump(mode="json")), text=True,
            capture_output=True, check=True, env={**os.environ, "PYTHONHASHSEED": hash_seed},
        )  # fmt: skip
        here.append(done.stdout.strip())
    assert len(set(here)) == 1, here


def test_what_is_built_stops_a_robot_and_what_is_pulled_down_lets_it_pass(scenario_of: Make) -> None:
    wall = Building(footprint=((54, 40), (55, 40), (55, 60), (54, 60)), height_m=3)
    car = Vehicle(loop=((20, 20), (80, 20), (80, 80), (20, 80)), speed_mps=3)
    world = World(scenario_of(changes=(Change(at_s=0.5, until_s=4.0, build=wall),), vehicles=(car,)), (ROBOT,))
    run(world, 4.0, {ROBOT: (2.0, 0.0)})
    bumper_m = 0.5 * world.scenario.robot.size_m[0]
    assert world.position_m(ROBOT)[0] + bumper_m == pytest.approx(54.0, abs=0.1)
    driven = world.vehicle_poses()[0]
    run(world, 3.0, {ROBOT: (2.0, 0.0)})
    assert world.position_m(ROBOT)[0] > 56.0
    assert world.position_m(ROBOT)[2] == pytest.approx(0.0, abs=0.03)
    assert np.hypot(*(world.vehicle_poses()[0] - driven)[:2]) == pytest.approx(9.0, abs=0.5)
