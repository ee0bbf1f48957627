"""Pose filter and attitude against closed formulas, a textbook Kalman step and simulated drives with known truth."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from orograph.geometry import rotation
from orograph.messages import Sensors
from orograph.navigation.attitude import SlopeFilter
from orograph.navigation.ekf import PoseFilter, X, Y, Z
from orograph.scenario import NavigationSensorsSpec

FRAME_NS = 100_000_000
SPEC = NavigationSensorsSpec()


def sensors(k, x=0.0, y=0.0, z=0.0, roll=0.0, pitch=0.0, yaw=0.0, rate=0.0, v=0.0, quality=2):
    return Sensors(k * FRAME_NS, quality, x, y, z, roll, pitch, yaw, rate, v)


def noisy(rng, k, pose, rate, v, quality=2, scale=1.0):
    """The readings of a robot on level ground, noise as the specification says."""
    x, y, yaw = pose
    gps = {0: 0.0, 1: SPEC.gps_single_m, 2: SPEC.gps_differential_m}[quality]
    n = rng.standard_normal(8)
    a = math.radians(SPEC.attitude_deg)
    return sensors(k, x + gps * n[0], y + gps * n[1], 1.5 * gps * n[2], a * n[3], a * n[4],
                   math.remainder(yaw + math.radians(SPEC.heading_deg) * n[5], math.tau),
                   rate + SPEC.yaw_rate_radps * n[6], v * scale + SPEC.odometry_mps * n[7], quality)  # fmt: skip


def drive(filter_, seconds, seed, quality=lambda k: 2, scale=1.0, rate=lambda k: 0.15 * math.sin(k / 30), begin=0,
          at=(0.0, 0.0, 0.0)):  # fmt: skip
    """Errors (n, 3) in x, y, yaw of a drive at 2 m/s along a winding line, and its last true pose."""
    rng = np.random.default_rng(seed)
    x, y, yaw = at
    errors = []
    for k in range(begin, begin + round(seconds * 10)):
        w = rate(k) if k > begin else 0.0
        if k > begin:
            x, y = x + 0.2 * math.cos(yaw + 0.05 * w), y + 0.2 * math.sin(yaw + 0.05 * w)
            yaw += 0.1 * w
        filter_.update(noisy(rng, k, (x, y, yaw), w, 2.0 if k > begin else 0.0, quality(k), scale), None)
        errors.append((filter_.x_m - x, filter_.y_m - y, math.remainder(filter_.yaw_rad - yaw, math.tau)))
    return np.array(errors), (x, y, yaw)


def started(sigma=0.3):
    out = PoseFilter(SPEC)
    out.start(0.0, 0.0, 0.0, 0.0, sigma, math.radians(5))
    return out


@given(st.floats(-0.3, 0.3), st.floats(-0.3, 0.3), st.floats(-3.1, 3.1))
def test_roll_and_pitch_put_the_robots_z_axis_on_the_grounds_normal(slope_x, slope_y, yaw):
    slope = SlopeFilter(1e-3)
    slope.slope_x, slope.slope_y = slope_x, slope_y
    roll, pitch = slope.roll_pitch(yaw)
    normal = np.array([-slope_x, -slope_y, 1.0]) / math.sqrt(1 + slope_x**2 + slope_y**2)
    np.testing.assert_allclose(rotation(roll, pitch, yaw)[:, 2], normal, atol=1e-12)


@given(st.floats(-0.3, 0.3), st.floats(-0.3, 0.3), st.floats(-3.1, 3.1))
def test_the_first_attitude_is_taken_as_it_is(roll, pitch, yaw):
    slope = SlopeFilter(math.radians(0.1))
    slope.update(roll, pitch, yaw, 0.0, 0.1)
    np.testing.assert_allclose(slope.roll_pitch(yaw), (roll, pitch), atol=1e-5)


def test_attitude_noise_averages_out_while_the_robot_turns_on_a_slope():
    slope, rng, sigma = SlopeFilter(math.radians(0.1)), np.random.default_rng(3), math.radians(0.1)
    truth = SlopeFilter(1.0)
    truth.slope_x, truth.slope_y = 0.12, -0.07
    errors = []
    for k in range(200):
        yaw = 0.15 * k
        roll, pitch = truth.roll_pitch(yaw)
        slope.update(roll + sigma * rng.standard_normal(), pitch + sigma * rng.standard_normal(), yaw, 0.0, 0.1)
        errors.append(np.subtract(slope.roll_pitch(yaw), (roll, pitch)))
    assert np.degrees(np.abs(errors[100:]).max()) < 0.03


def test_attitude_follows_a_slope_that_changes_underway():
    slope = SlopeFilter(math.radians(0.1))
    for k in range(40):
        slope.update(0.0, -0.002 * k, 0.0, 0.25, 0.1)
    assert slope.roll_pitch(0.0)[1] == pytest.approx(-0.078, abs=0.004)


@pytest.mark.parametrize("seed", range(5))
def test_differential_gps_gives_centimetres_and_an_honest_sigma(seed):
    filter_ = started()
    errors, _ = drive(filter_, 60, seed)
    assert np.sqrt(np.mean(errors[50:, :2] ** 2)) < 0.03
    assert np.degrees(np.sqrt(np.mean(errors[50:, 2] ** 2))) < 0.15
    assert 0.4 < np.sqrt(np.mean(errors[50:, :2] ** 2)) / filter_.position_sigma_m < 2.0


@pytest.mark.parametrize("seed", range(5))
def test_single_gps_is_smoothed_by_odometry(seed):
    filter_ = started()
    errors, _ = drive(filter_, 120, seed, quality=lambda k: 1)
    assert np.sqrt(np.mean(errors[300:, :2] ** 2)) < 0.5, "raw noise is 1.5 m"
    assert filter_.position_sigma_m < 0.6


def test_without_gps_the_error_stays_within_what_sigma_says():
    errors = []
    for seed in range(12):
        filter_ = started(0.05)
        errors.append(drive(filter_, 60, seed, quality=lambda k: 0)[0][-1, :2])
    assert 0.1 < filter_.position_sigma_m < 5
    assert np.max(np.abs(errors)) < 3.5 * filter_.position_sigma_m


def test_the_odometry_scale_is_learned_where_gps_is_good():
    filter_ = PoseFilter(NavigationSensorsSpec(odometry_scale=0.05))
    filter_.start(0, 0, 0, 0, 0.3, 0.1)
    _, at = drive(filter_, 60, 1, scale=1 / 1.05)
    errors, _ = drive(filter_, 10, 2, quality=lambda k: 0, scale=1 / 1.05, begin=600, at=at)
    assert np.abs(errors[-1, :2]).max() < 0.35, "unlearned, 20 m at 5 % would be 1 m off"


def test_a_short_gps_jump_is_left_out_and_one_that_lasts_is_believed():
    filter_ = started()
    for k in range(20):
        filter_.update(sensors(k), None)
    for k in range(20, 24):
        filter_.update(sensors(k, x=20.0), None)
    assert abs(filter_.x_m) < 0.05
    for k in range(24, 40):
        filter_.update(sensors(k, x=20.0), None)
    assert filter_.x_m == pytest.approx(20.0, abs=0.1)


def test_without_a_start_it_waits_for_gps_and_then_stands_there():
    filter_ = PoseFilter(SPEC)
    filter_.update(sensors(7, quality=0), None)
    assert not filter_.started
    assert filter_.position_sigma_m == math.inf
    filter_.update(sensors(8, 30.0, 40.0, 5.0, yaw=1.0, quality=1), None)
    assert (filter_.x_m, filter_.y_m, filter_.z_m, filter_.yaw_rad) == (30.0, 40.0, 5.0, 1.0)
    assert filter_.position_sigma_m >= SPEC.gps_single_m


def test_height_follows_the_slope_without_gps():
    filter_ = started(0.01)
    slope = math.atan(0.1)
    for k in range(101):
        filter_.update(sensors(k, pitch=-slope, v=2.0 if k else 0.0, quality=0), None)
    assert filter_.x_m == pytest.approx(20 * math.cos(slope), abs=0.05)
    assert filter_.z_m == pytest.approx(20 * math.sin(slope), abs=0.05)


def test_the_prior_ground_holds_the_height_where_there_is_no_gps():
    filter_ = PoseFilter(SPEC)
    filter_.start(0.0, 0.0, 12.0, 0.0, 5.0, 0.1)
    for k in range(600):
        filter_.update(sensors(k, quality=0), 10.0)
    assert filter_.z_m == pytest.approx(10.0, abs=0.3)


def test_axis_by_axis_correction_equals_the_textbook_step_with_both():
    filter_ = started()
    drive(filter_, 5, 4, quality=lambda k: 0)
    state, P = filter_._state.copy(), filter_._P.copy()
    measured, variance = np.array([filter_.x_m + 0.1, filter_.y_m - 0.2]), 0.3
    H = np.eye(5)[[X, Y]]
    K = P @ H.T @ np.linalg.inv(H @ P @ H.T + variance * np.eye(2))
    filter_._gated("xy", ((X, measured[0]), (Y, measured[1])), variance)
    np.testing.assert_allclose(filter_._state, state + K @ (measured - H @ state), rtol=0, atol=1e-12)
    np.testing.assert_allclose(filter_._P, (np.eye(5) - K @ H) @ P, rtol=0, atol=1e-12)


@pytest.mark.parametrize(("amplitude_m", "steepest"), [(0.0, 0.0), (1.1, 0.15), (2.2, 0.3)])
def test_heights_on_hills_are_as_sure_as_they_are_true(amplitude_m, steepest):
    """A winding drive over two waves of 65 and 75 m: normalised squared errors of z around one."""
    rng, filter_, squares, slopes = np.random.default_rng(4), started(), [], []
    u, w = math.tau / 65, math.tau / 75
    height = lambda x, y: amplitude_m * (math.sin(u * x) + math.sin(w * y))  # noqa: E731
    x = y = 0.0
    yaw = 0.3
    for k in range(1200):
        rate, v = (0.25 * math.sin(k / 25), 2.3) if k else (0.0, 0.0)
        middle = yaw + 0.05 * rate
        gx, gy = (amplitude_m * a * math.cos(a * b) for a, b in ((u, x), (w, y)))
        moved = 0.1 * v / math.sqrt(1 + (gx * math.cos(middle) + gy * math.sin(middle)) ** 2)
        slide = 0.065 * abs(rate)  # of a skid-steer that turns: downhill
        x, y, yaw = (
            x + moved * math.cos(middle) - slide * gx,
            y + moved * math.sin(middle) - slide * gy,
            yaw + 0.1 * rate,
        )
        gx, gy = (amplitude_m * a * math.cos(a * b) for a, b in ((u, x), (w, y)))
        ahead, left = gx * math.cos(yaw) + gy * math.sin(yaw), gy * math.cos(yaw) - gx * math.sin(yaw)
        roll, pitch = math.asin(left / math.sqrt(1 + ahead**2 + left**2)), -math.atan(ahead)
        told = noisy(rng, k, (x, y, yaw), rate, v)
        z = height(x, y)
        filter_.update(replace(told, gps_z_m=told.gps_z_m + z, roll_rad=told.roll_rad + roll,
                               pitch_rad=told.pitch_rad + pitch), None)  # fmt: skip
        slopes.append(math.hypot(ahead, left))
        squares.append((filter_.z_m - z) ** 2 / filter_._P[Z, Z])
    assert max(slopes) == pytest.approx(steepest, abs=0.03)
    assert 0.2 < np.mean(squares[50:]) < 2.0
