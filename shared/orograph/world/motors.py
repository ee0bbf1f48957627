"""Wheel motors of all robots at once: wanted body speed -> wheel speeds within limits -> torques within limits.

A skid-steer on isotropic Coulomb friction: while it turns at rate w, each wheel slips sideways at w * wheelbase / 2,
and the friction of all wheels has no moment left when the sides run at +- w * (track + wheelbase^2 / track) / 2. So the
track that makes a yaw rate of wheel speeds is the *effective* one; commands and odometry both use it; the rest is slip.
"""

from __future__ import annotations

import numpy as np

from orograph.arrays import F64
from orograph.scenario import RobotSpec
from orograph.world.motor_kernels import ramp, servo_torques_nm
from orograph.world.robot_body import WHEELS

SERVO_GAIN_NMS = 10.0
"""Torque per wheel speed error: what brings a free wheel of 0.05 kg m^2 there in one 5 ms step, so it never rings."""
SERVO_INTEGRAL_S = 0.1
"""Time constant of the integral part, which holds a standing robot on a slope."""


def effective_track_m(spec: RobotSpec) -> float:
    """Distance of the wheel sides that yields the true yaw rate of a skid-steer on level ground."""
    return spec.track_m + spec.wheelbase_m**2 / spec.track_m


def odometry(spec: RobotSpec, wheel_turns_rad: F64, duration_s: float) -> tuple[float, float]:
    """(speed [m/s], yaw rate [rad/s]), mean over a time in which the wheels turned by these angles (4,)."""
    front_left, front_right, rear_left, rear_right = (wheel_turns_rad * (spec.wheel_radius_m / duration_s)).tolist()
    left, right = 0.5 * (front_left + rear_left), 0.5 * (front_right + rear_right)
    return 0.5 * (left + right), (right - left) / effective_track_m(spec)


def within_limits(spec: RobotSpec, v_mps: float, yaw_rate_radps: float) -> tuple[float, float]:
    """The nearest wanted speed that the wheels can do; turning goes before driving on."""
    half_track = 0.5 * effective_track_m(spec)
    yaw_rate_max = min(spec.yaw_rate_max_radps, spec.speed_max_mps / half_track)
    yaw_rate = min(yaw_rate_max, max(-yaw_rate_max, yaw_rate_radps))
    v_max = spec.speed_max_mps - abs(yaw_rate) * half_track
    return min(v_max, max(-v_max, v_mps)), yaw_rate


class Motors:
    """State of the motors of n robots: set speed after the acceleration limit, and the servos' integral parts."""

    def __init__(self, spec: RobotSpec, robots: int) -> None:
        half_track = 0.5 * effective_track_m(spec)
        self._spec = spec
        self._wheels_of_body = np.array([[1.0, -y * half_track] for _, y in WHEELS]).T / spec.wheel_radius_m
        self._acceleration = spec.acceleration_max_mps2 * np.array([1.0, 1.0 / half_track])
        self._wanted = np.zeros((robots, 2))
        self._set = np.zeros((robots, 2))
        self._integral_radps = np.zeros((robots, 4))

    def want(self, robot: int, v_mps: float, yaw_rate_radps: float) -> None:
        """Set one robot's wanted body speed."""
        self._wanted[robot] = within_limits(self._spec, v_mps, yaw_rate_radps)

    def reset(self, robot: int) -> None:
        """One robot's motors stand still and want nothing."""
        self._wanted[robot] = self._set[robot] = 0.0
        self._integral_radps[robot] = 0.0

    def torques_nm(self, wheel_speeds_radps: F64, step_s: float) -> F64:
        """Torques (n, 4) for the next step, never more than the motor's largest, from the wheels' speeds (n, 4)."""
        ramp(self._set, self._wanted, self._acceleration * step_s)
        limit_nm, share = self._spec.wheel_torque_max_nm, step_s / SERVO_INTEGRAL_S
        return servo_torques_nm(
            self._set, self._wheels_of_body, wheel_speeds_radps, self._integral_radps, SERVO_GAIN_NMS, limit_nm, share
        )
