"""Motors: limits, odometry, and a servo that neither rings nor exceeds its torque."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from orograph.scenario import RobotSpec
from orograph.world.motors import Motors, effective_track_m, odometry, within_limits
from orograph.world.robot_body import AXLE_INERTIA_KGM2

SPEC = RobotSpec()
STEP_S = 0.005


def test_effective_track_by_hand() -> None:
    assert effective_track_m(SPEC) == pytest.approx(0.50 + 0.45**2 / 0.50)  # 0.905 m


def test_effective_track_balances_the_friction_moments() -> None:
    """Slow oracle: the yaw moment of four Coulomb contacts is zero at that wheel speed, and only there."""

    def moment(side_speed_mps: float, yaw_rate: float = 1.0) -> float:
        total = 0.0
        for sx in (1, -1):
            for sy in (1, -1):
                x, y = 0.5 * sx * SPEC.wheelbase_m, 0.5 * sy * SPEC.track_m
                # The wheel's lowest point moves at -sy * side_speed over the hub: that is subtracted.
                slip_x, slip_y = -yaw_rate * y + sy * side_speed_mps, yaw_rate * x
                size = math.hypot(slip_x, slip_y)
                total += x * (-slip_y / size) - y * (-slip_x / size)
        return total

    balanced = 0.5 * effective_track_m(SPEC)
    assert moment(balanced) == pytest.approx(0.0, abs=1e-12)
    assert moment(balanced * 1.05) > 0.01
    assert moment(balanced * 0.95) < -0.01


@given(v=st.floats(-20, 20), yaw_rate=st.floats(-20, 20))
def test_limits_hold_and_signs_stay(v: float, yaw_rate: float) -> None:
    limited_v, limited_yaw_rate = within_limits(SPEC, v, yaw_rate)
    assert abs(limited_yaw_rate) <= SPEC.yaw_rate_max_radps
    assert abs(limited_v) + abs(limited_yaw_rate) * effective_track_m(SPEC) / 2 <= SPEC.speed_max_mps + 1e-12
    assert limited_v * v >= 0 and limited_yaw_rate * yaw_rate >= 0


def test_what_is_possible_is_left_alone() -> None:
    assert within_limits(SPEC, 1.5, -0.7) == (1.5, -0.7)


@given(v=st.floats(-3, 3), yaw_rate=st.floats(-2, 2))
def test_odometry_reads_back_what_wheels_did(v: float, yaw_rate: float) -> None:
    half_track = effective_track_m(SPEC) / 2
    left, right = (v - yaw_rate * half_track) * 0.1 / 0.11, (v + yaw_rate * half_track) * 0.1 / 0.11
    assert odometry(SPEC, np.array([left, right, left, right]), 0.1) == pytest.approx((v, yaw_rate), abs=1e-9)


def test_free_wheels_follow_the_ramp_without_ringing() -> None:
    motors, wheels = Motors(SPEC, 1), np.zeros((1, 4))
    motors.want(0, 1.0, 0.0)
    seen = []
    for _ in range(300):
        wheels += motors.torques_nm(wheels, STEP_S) * STEP_S / AXLE_INERTIA_KGM2
        seen.append(wheels[0, 0] * SPEC.wheel_radius_m)
    ramp = [min(1.0, SPEC.acceleration_max_mps2 * STEP_S * (k + 1)) for k in range(300)]
    assert np.abs(np.array(seen) - ramp).max() < 0.05
    assert seen[-1] == pytest.approx(1.0, abs=1e-4)


def test_torque_never_exceeds_the_motor() -> None:
    motors = Motors(SPEC, 2)
    motors.want(1, 3.0, 0.0)
    torques = [motors.torques_nm(np.zeros((2, 4)), STEP_S) for _ in range(400)]  # wheels held fast
    assert np.abs(torques).max() == SPEC.wheel_torque_max_nm
    assert (np.array(torques)[:, 0] == 0).all()


def test_reset_forgets() -> None:
    motors = Motors(SPEC, 1)
    motors.want(0, 2.0, 1.0)
    motors.torques_nm(np.zeros((1, 4)), STEP_S)
    motors.reset(0)
    assert (motors.torques_nm(np.zeros((1, 4)), STEP_S) == 0).all()
