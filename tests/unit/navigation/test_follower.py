"""Path follower: speeds that can be braked to, curves, turning on the spot, stopping short."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from orograph.navigation.follower import BRAKE_MPS2, LATERAL_MPS2, NARROW_MPS, Follower, speed_profile
from orograph.navigation.planner import LETHAL_M, LocalPath
from orograph.scenario import RobotSpec


def path_of(xy, clearance=5.0):
    xy = np.asarray(xy, np.float64)
    return LocalPath(xy, np.full(len(xy), clearance), (len(xy) - 1,), False)


def straight(length=40.0, clearance=5.0):
    x = np.arange(0.0, length + 0.25, 0.5)
    return path_of(np.column_stack([x, np.zeros_like(x)]), clearance)


def arc_of(path):
    return np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(path.xy_m, axis=0).T))])


@given(st.lists(st.floats(LETHAL_M, 6.0), min_size=81, max_size=81))
def test_every_slower_place_can_be_braked_for(clearances):
    path = LocalPath(straight().xy_m, np.array(clearances), (80,), False)
    arc = arc_of(path)
    v = speed_profile(path, arc, 2.8)
    assert (v <= 2.8 + 1e-9).all()
    assert (v[:-1] ** 2 - v[1:] ** 2 <= 2 * BRAKE_MPS2 * np.diff(arc) + 1e-9).all()
    assert v[-1] == pytest.approx(0.5)


def test_near_obstacles_it_is_slow():
    assert speed_profile(straight(clearance=LETHAL_M), arc_of(straight()), 2.8)[10] == pytest.approx(NARROW_MPS)


@pytest.mark.parametrize("radius", [2.0, 5.0, 20.0])
def test_in_a_curve_the_sideways_pull_is_bounded(radius):
    angle = np.arange(0, math.pi, 0.5 / radius)
    path = path_of(np.column_stack([radius * np.cos(angle), radius * np.sin(angle)]))
    middle = speed_profile(path, arc_of(path), 9.0)[len(angle) // 2]
    assert middle**2 / radius <= 1.1 * LATERAL_MPS2
    assert middle**2 / radius >= 0.7 * min(LATERAL_MPS2, middle**2 / radius)


def test_straight_ahead_it_drives_straight_and_fast():
    follower = Follower(RobotSpec())
    follower.take(straight())
    assert follower.advance(5.1, 0.0) == pytest.approx(5.1)
    command = follower.command(5.1, 0.0, 0.0, 2.5, 12.0)
    assert command.yaw_rate_radps == pytest.approx(0.0, abs=1e-9)
    assert command.v_mps > 2.5


@pytest.mark.parametrize("side", [1, -1])
def test_beside_the_path_it_steers_back(side):
    follower = Follower(RobotSpec())
    follower.take(straight())
    follower.advance(5.0, 0.5 * side)
    assert follower.command(5.0, 0.5 * side, 0.0, 1.0, 12.0).yaw_rate_radps * side < -0.1


def test_facing_away_it_turns_on_the_spot_until_it_faces_the_path():
    follower = Follower(RobotSpec())
    follower.take(straight())
    follower.advance(0.0, 0.0)
    for yaw, v_is_zero in [(2.5, True), (0.5, True), (0.2, False), (0.5, False)]:
        command = follower.command(0.0, 0.0, yaw, 0.0, 12.0)
        assert (command.v_mps == 0.0) == v_is_zero, yaw
        assert command.yaw_rate_radps < 0


def test_at_speed_it_brakes_before_it_turns_hard():
    follower = Follower(RobotSpec())
    follower.take(straight())
    follower.advance(0.0, 0.0)
    command = follower.command(0.0, 0.0, 2.0, 2.5, 12.0)
    assert command.v_mps == 0.0
    assert abs(command.yaw_rate_radps) * 2.5 <= LATERAL_MPS2 + 1e-9


def test_before_an_obstacle_it_stops():
    follower = Follower(RobotSpec())
    follower.take(straight())
    x, v, travelled = 0.0, 2.8, 0.0
    for _ in range(200):
        follower.advance(x, 0.0)
        command = follower.command(x, 0.0, 0.0, v, 10.0 - x)
        v = max(command.v_mps, v - 0.2)
        x += 0.1 * v
        travelled = x
    assert 9.0 < travelled < 9.9


def test_it_reaches_the_end_and_has_nothing_left():
    follower = Follower(RobotSpec())
    follower.take(straight(10.0))
    follower.advance(5.0, 0.0)
    follower.advance(9.9, 0.1)
    assert follower.remaining_m == pytest.approx(0.0, abs=0.5)
    assert follower.off_path_m(10.0, 0.3) == pytest.approx(0.3, abs=0.01)


def test_a_path_that_comes_back_near_itself_is_followed_in_order():
    out = np.column_stack([np.arange(0, 20, 0.5), np.zeros(40)])
    back = np.column_stack([np.arange(20, 0, -0.5), np.full(40, 1.0)])
    follower = Follower(RobotSpec())
    follower.take(path_of(np.vstack([out, back])))
    assert follower.advance(2.0, 0.6) < 3.0
