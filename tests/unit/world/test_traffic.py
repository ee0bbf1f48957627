"""Vehicles keep to their loop, stop for what stands in their lane, and go on."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import pytest
from orograph.scenario import Scenario, Vehicle
from orograph.scene import build_scene
from orograph.world.traffic import BRAKING_MPS2, PATIENCE_S, STOP_GAP_M, TABLE_STEP_M, Lane, Traffic

SQUARE = ((20.0, 20.0), (80.0, 20.0), (80.0, 80.0), (20.0, 80.0))
NOBODY = np.zeros((0, 2))
FRAME_S = 0.1


def traffic_of(scenario_of: Callable[..., Scenario], *vehicles: Vehicle) -> Traffic:
    scenario = scenario_of(vehicles=vehicles)
    return Traffic(build_scene(scenario), scenario.vehicles)


def test_free_lane_is_driven_at_constant_speed(scenario_of: Callable[..., Scenario]) -> None:
    traffic = traffic_of(scenario_of, Vehicle(loop=SQUARE, speed_mps=5.0))
    for _ in range(100):
        traffic.drive(NOBODY, 0.5, FRAME_S)
    assert traffic.lanes[0].distance_m == pytest.approx(50.0)


def test_stops_before_a_robot_and_goes_on(scenario_of: Callable[..., Scenario]) -> None:
    traffic = traffic_of(scenario_of, Vehicle(loop=SQUARE, speed_mps=6.0))
    robot = np.array([[60.0, 20.0]])
    speeds = []
    for _ in range(200):
        traffic.drive(robot, 0.5, FRAME_S)
        speeds.append(traffic.lanes[0].speed_mps)
    x, y, _, _ = traffic.lanes[0].pose()
    nose_to_robot = 60.0 - (x + 0.5 * 4.2) - 0.5
    assert speeds[-1] == 0.0 and y == pytest.approx(20.0)
    assert STOP_GAP_M - 1.0 < nose_to_robot < STOP_GAP_M + 1.5
    assert -np.diff(speeds).min() <= 2 * BRAKING_MPS2 * FRAME_S + 1e-9  # no harder than its brakes
    for _ in range(100):
        traffic.drive(NOBODY, 0.5, FRAME_S)
    assert traffic.lanes[0].speed_mps == pytest.approx(6.0)


def test_robot_beside_the_lane_is_passed(scenario_of: Callable[..., Scenario]) -> None:
    traffic = traffic_of(scenario_of, Vehicle(loop=SQUARE, speed_mps=5.0))
    for _ in range(100):
        traffic.drive(np.array([[50.0, 23.0]]), 0.5, FRAME_S)
    assert traffic.lanes[0].distance_m == pytest.approx(50.0)


def test_follower_never_runs_into_a_slower_one(scenario_of: Callable[..., Scenario]) -> None:
    slow = Vehicle(loop=SQUARE, speed_mps=2.0, start_fraction=0.2)
    traffic = traffic_of(scenario_of, slow, Vehicle(loop=SQUARE, speed_mps=8.0))
    closest = math.inf
    for _ in range(600):
        traffic.drive(NOBODY, 0.5, FRAME_S)
        (ax, ay, *_), (bx, by, *_) = (lane.pose() for lane in traffic.lanes)
        closest = min(closest, math.hypot(ax - bx, ay - by))
    assert closest > 4.2


def test_two_that_face_each_other_do_not_wait_for_ever(scenario_of: Callable[..., Scenario]) -> None:
    traffic = traffic_of(scenario_of, Vehicle(loop=SQUARE), Vehicle(loop=SQUARE[::-1]))
    stood_s = 0.0
    before = [0.0, 0.0]
    for _ in range(600):
        traffic.drive(NOBODY, 0.5, FRAME_S)
        now = [lane.distance_m for lane in traffic.lanes]
        stood_s = stood_s + FRAME_S if now == before else 0.0
        assert stood_s < 2 * PATIENCE_S
        before = now
    assert min(before) > 100.0


def test_gap_by_hand(scenario_of: Callable[..., Scenario]) -> None:
    lane = Lane(build_scene(scenario_of(vehicles=(Vehicle(loop=SQUARE),))), 0, Vehicle(loop=SQUARE))
    lane.distance_m = 20.0  # past the first corner's arc, heading east
    x, y, _, yaw = lane.pose()
    assert yaw == pytest.approx(0.0)
    # The lane is 0.9 + 0.6 m to each side, the disc 0.5 m: blocked from 2 m before its centre, 7.9 m off the nose.
    assert 5.9 <= lane.gap_m(np.array([[x + 10.0, y, 0.5]])) < 5.9 + 2 * TABLE_STEP_M
    assert lane.gap_m(np.array([[x - 3.0, y, 0.5]])) == math.inf
    assert lane.gap_m(np.zeros((0, 3))) == math.inf


@pytest.mark.parametrize("across_m", [0.5, 2.0, 2.6, 3.2])
@pytest.mark.parametrize("along_m", [-3.0, 0.0, 3.0])
def test_a_lorry_that_swings_out_in_a_bend_touches_nobody_who_stands_there(
    scenario_of: Callable[..., Scenario], across_m: float, along_m: float
) -> None:
    """Places outside the corner (80, 20), on the bisector and beside it."""
    lorry = Vehicle(loop=SQUARE, size_m=(8.0, 2.4, 3.1))
    traffic = traffic_of(scenario_of, lorry)
    half = math.sqrt(0.5)
    robot = np.array([80.0 + half * (across_m - 2.0 + along_m), 20.0 - half * (across_m - 2.0 - along_m)])
    for _ in range(250):
        traffic.drive(robot[None], 0.47, FRAME_S)
        x, y, _, yaw = traffic.lanes[0].pose()
        ahead = math.cos(yaw) * (robot[0] - x) + math.sin(yaw) * (robot[1] - y)
        left = math.cos(yaw) * (robot[1] - y) - math.sin(yaw) * (robot[0] - x)
        assert math.hypot(max(0.0, abs(ahead) - 4.0), max(0.0, abs(left) - 1.2)) > 0.47
