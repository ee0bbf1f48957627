"""Boxes of robots and vehicles, the same for lasers and physics, and how bodies stand."""

from __future__ import annotations

import math

import dartpy as dart
import numpy as np
import pytest
from orograph.scenario import RobotSpec, Vehicle
from orograph.scene import build_scene
from orograph.scene.bodies import BodyBox, robot_box, standing_robot, vehicle_box
from orograph.sensing.bodies import Bodies
from orograph.world.robot_body import RobotBody
from orograph.world.vehicle_body import VehicleBody

LOOP = ((20.0, 20.0), (80.0, 20.0), (80.0, 80.0))


def test_a_robots_box_begins_below_its_wheels_tops_and_ends_at_its_height():
    box = robot_box(RobotSpec(size_m=(0.7, 0.6, 0.4), wheel_radius_m=0.12))
    assert box == pytest.approx((0.7, 0.6, 0.31, 0.09))
    assert box.centre_m == pytest.approx((0, 0, 0.245))


@pytest.mark.parametrize(("height_m", "expected"), [(1.6, (4.2, 1.8, 1.4, 0.2)), (0.3, (4.2, 1.8, 0.15, 0.15))])
def test_a_vehicles_box_ends_at_its_height_and_is_never_all_clearance(height_m, expected):
    assert vehicle_box(Vehicle(loop=LOOP, size_m=(4.2, 1.8, height_m))) == pytest.approx(expected)


def boxes_in(skeleton) -> list[BodyBox]:
    nodes = [n for i in range(skeleton.getNumBodyNodes()) for n in skeleton.getBodyNode(i).getShapeNodes()]
    nodes = [node for node in nodes if isinstance(node.getShape(), dart.dynamics.BoxShape)]
    return [BodyBox(*(size := node.getShape().getSize()), node.getRelativeTranslation()[2] - size[2] / 2)
            for node in nodes]  # fmt: skip


def test_the_laser_sees_the_boxes_that_physics_collides(flat_world, poses_at):
    world = flat_world(vehicles=[{"loop": LOOP, "size_m": [4.0, 2.0, 1.5]}])
    solid = [*boxes_in(RobotBody("r", world.robot).skeleton), *boxes_in(VehicleBody("v", world.vehicles[0]).skeleton)]
    poses = poses_at((50, 50, 0, 0), (53, 50, 0, 0), None, (58, 50, 0, 0))
    seen = Bodies(world).boxes(poses, 0, 80.0)
    np.testing.assert_allclose(2 * seen.half_m, [box[:3] for box in solid])
    np.testing.assert_allclose(seen.centres_m[:, 2] - seen.half_m[:, 2], [box.clearance_m for box in solid])


def test_a_standing_robot_is_upright_to_its_slope_and_looks_along_its_heading(flat_world):
    scene = build_scene(flat_world(terrain={"slope_x": 0.2, "slope_y": -0.1}))
    R, position = standing_robot(scene, 50.0, 80.0, 0.7)
    np.testing.assert_allclose(R @ R.T, np.eye(3), atol=1e-12)
    assert np.linalg.det(R) == pytest.approx(1.0)
    np.testing.assert_allclose(R[:, 2], np.array([-0.2, 0.1, 1.0]) / math.sqrt(1.05))
    assert math.atan2(R[1, 0], R[0, 0]) == pytest.approx(0.7), "the nose, seen from above"
    np.testing.assert_allclose(position, [50, 80, 2.0])
