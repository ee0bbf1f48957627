"""Extended Kalman filter for the pose: odometry and gyro predict; GPS, heading and prior ground correct.

State (x, y, z, yaw, odometry scale) in the map frame. Speed and yaw rate are inputs, not states: both are measured
once per frame over exactly the interval that is predicted. Attitude is `attitude.py`.
"""

from __future__ import annotations

import math

import numpy as np

from orograph.arrays import F64
from orograph.fields import saturated
from orograph.geometry import wrap_angle
from orograph.messages import Pose, Sensors
from orograph.navigation.attitude import SlopeFilter
from orograph.scenario import NavigationSensorsSpec

X, Y, Z, YAW, SCALE = range(5)

SLIP_ALONG, SLIP_ACROSS = 0.02, 0.01
"""One sigma of the wheels' slip, per metre driven straight."""
TURN_SLIP_ALONG_M, TURN_SLIP_ACROSS_M = 0.2, 0.1
"""The same per radian turned: a skid-steer's wheels have no grip left to brake with while they turn it."""
SLIDE_M = 0.65
"""So far it slides downhill meanwhile, per radian and slope."""
CLIMB_SIGMA, CLIMB_SHARE = 0.002, 0.03
"""One sigma of the slope that turns distance into height [m/m], and its part that grows with the slope."""
GATE_SIGMAS = 4.0
"""GPS further than this from the prediction is a jump and left out ..."""
GATE_PATIENCE = 5
"""... unless it insists for this many frames: then the prediction is wrong (wheels that spun, a push)."""
GROUND_SIGMA_M = 1.0
GROUND_PERIOD_S = 5.0
"""The prior ground is one map, not a new measurement per frame: it corrects seldom and softly."""


class PoseFilter:
    """Pose of one robot from its `Sensors`, one per frame; `started` is False until it has a position to start from."""

    def __init__(self, spec: NavigationSensorsSpec) -> None:
        self._spec = spec
        self._slope = SlopeFilter(math.radians(spec.attitude_deg))
        self._state: F64 = np.array([0.0, 0.0, 0.0, 0.0, 1.0])
        self._P: F64 = np.zeros((5, 5))
        self._last: Sensors | None = None
        self._refused = {"xy": 0, "z": 0}
        self._ground_stamp_ns = 0
        self.started = False
        self.moved_m = 0.0

    @property
    def x_m(self) -> float:
        """Estimated x in the map frame."""
        return float(self._state[X])

    @property
    def y_m(self) -> float:
        """Estimated y in the map frame."""
        return float(self._state[Y])

    @property
    def z_m(self) -> float:
        """Estimated height of the ground under the robot's body."""
        return float(self._state[Z])

    @property
    def yaw_rad(self) -> float:
        """Estimated heading in [-pi, pi)."""
        return wrap_angle(float(self._state[YAW]))

    @property
    def v_mps(self) -> float:
        """Speed by the corrected odometry."""
        return float(self._last.odometry_v_mps * self._state[SCALE]) if self._last else 0.0

    @property
    def yaw_rate_radps(self) -> float:
        """Newest yaw rate of the IMU."""
        return self._last.yaw_rate_radps if self._last else 0.0

    @property
    def position_sigma_m(self) -> float:
        """One sigma of x, y; infinite before the start."""
        return math.sqrt(0.5 * (self._P[X, X] + self._P[Y, Y])) if self.started else math.inf

    def start(self, x_m: float, y_m: float, z_m: float, yaw_rad: float, sigma_m: float, yaw_sigma_rad: float) -> None:
        """Begin at a place with one sigma for each of x, y and z, and for the heading."""
        self._state[:] = x_m, y_m, z_m, yaw_rad, 1.0
        self._P = np.diag([sigma_m**2, sigma_m**2, sigma_m**2, yaw_sigma_rad**2, self._spec.odometry_scale**2])
        self.started = True

    def update(self, sensors: Sensors, ground_m: float | None) -> None:
        """One frame: predict to the sensors' stamp, correct with what they say and, now and then, the prior ground."""
        previous, self._last = self._last, sensors
        if not self.started:
            self._start_from_gps(sensors)
            self._slope.update(sensors.roll_rad, sensors.pitch_rad, self.yaw_rad, 0.0, 0.0)
            return
        if previous is not None:
            self._predict(sensors, (sensors.stamp_ns - previous.stamp_ns) * 1e-9)
        else:
            self._slope.update(sensors.roll_rad, sensors.pitch_rad, self.yaw_rad, 0.0, 0.0)
        self._correct_yaw(sensors.yaw_rad)
        self._correct_gps(sensors)
        self._correct_ground(sensors.stamp_ns, ground_m)

    def pose(self, stamp_ns: int) -> Pose:
        """The estimate as a message."""
        roll, pitch = self._slope.roll_pitch(self.yaw_rad)
        return saturated(
            Pose, stamp_ns=stamp_ns, x_m=self.x_m, y_m=self.y_m, z_m=self.z_m, roll_rad=roll, pitch_rad=pitch,
            yaw_rad=self.yaw_rad, position_sigma_m=self.position_sigma_m,
        )  # fmt: skip

    def _start_from_gps(self, sensors: Sensors) -> None:
        if sensors.gps_quality == 0:
            return
        sigma_m = self._gps_sigma_m(sensors.gps_quality) * max(1.0, self._spec.gps_height_factor)
        yaw_sigma = math.radians(self._spec.heading_deg)
        self.start(sensors.gps_x_m, sensors.gps_y_m, sensors.gps_z_m, sensors.yaw_rad, sigma_m, yaw_sigma)

    def _gps_sigma_m(self, quality: int) -> float:
        return self._spec.gps_differential_m if quality == 2 else self._spec.gps_single_m

    def _predict(self, sensors: Sensors, dt_s: float) -> None:
        """Move the state by the mean speed, yaw rate and slope of the interval."""
        turned = sensors.yaw_rate_radps * dt_s
        heading = float(self._state[YAW]) + 0.5 * turned
        wheels_m = sensors.odometry_v_mps * dt_s
        self._slope.update(sensors.roll_rad, sensors.pitch_rad, heading + 0.5 * turned, wheels_m, dt_s)
        climb, side = self._slope.passed(heading)
        wheels_m /= math.sqrt(1 + climb**2)
        moved = wheels_m * float(self._state[SCALE])
        c, s = math.cos(heading), math.sin(heading)
        ahead, left = np.array([c, s, climb]), np.array([-s, c, side])
        self._state[:3] += moved * ahead - SLIDE_M * abs(turned) * (climb * ahead + side * left)
        self._state[YAW] += turned
        F = np.eye(5)
        F[X, YAW], F[Y, YAW] = -moved * s, moved * c
        F[X, SCALE], F[Y, SCALE], F[Z, SCALE] = wheels_m * c, wheels_m * s, wheels_m * climb
        Q = self._process_noise(moved, turned, ahead, left, dt_s)
        Q[Z, Z] += ((CLIMB_SIGMA + CLIMB_SHARE * math.hypot(climb, side)) * moved) ** 2 + (1e-3 * dt_s) ** 2
        self._P = np.einsum("ij,jk,lk->il", F, self._P, F) + Q
        self.moved_m += abs(moved)

    def _process_noise(self, moved: float, turned: float, ahead: F64, left: F64, dt_s: float) -> F64:
        """Of the wheels' slip along the ground, `ahead` and `left` (3,), and of the heading."""
        along = (self._spec.odometry_mps * dt_s) ** 2 + (SLIP_ALONG * moved) ** 2
        along += (TURN_SLIP_ALONG_M * turned) ** 2
        across = (TURN_SLIP_ACROSS_M * turned) ** 2 + (SLIP_ACROSS * moved) ** 2
        Q = np.zeros((5, 5))
        Q[:3, :3] = along * np.outer(ahead, ahead) + across * np.outer(left, left)
        Q[YAW, YAW] = (self._spec.yaw_rate_radps * dt_s) ** 2
        Q[SCALE, SCALE] = (1e-4 * dt_s) ** 2
        return Q

    def _correct_yaw(self, yaw_rad: float) -> None:
        innovation = wrap_angle(yaw_rad - float(self._state[YAW]))
        self._correct(YAW, innovation, math.radians(self._spec.heading_deg) ** 2)

    def _correct_gps(self, sensors: Sensors) -> None:
        if sensors.gps_quality == 0:
            return
        sigma_m = self._gps_sigma_m(sensors.gps_quality)
        self._gated("xy", ((X, sensors.gps_x_m), (Y, sensors.gps_y_m)), sigma_m**2)
        self._gated("z", ((Z, sensors.gps_z_m),), (sigma_m * self._spec.gps_height_factor) ** 2)

    def _gated(self, name: str, measured: tuple[tuple[int, float], ...], variance: float) -> None:
        """Correct with measured states unless one of them is a jump; give in to a jump that lasts."""
        errors = [(i, value - float(self._state[i])) for i, value in measured]
        if all(error**2 <= GATE_SIGMAS**2 * (self._P[i, i] + variance) for i, error in errors):
            self._refused[name] = 0
            for i, value in measured:
                self._correct(i, value - float(self._state[i]), variance)
            return
        self._refused[name] += 1
        if self._refused[name] > GATE_PATIENCE:
            for i, error in errors:
                self._P[i, i] += error**2
            self._refused[name] = 0

    def _correct_ground(self, stamp_ns: int, ground_m: float | None) -> None:
        if ground_m is None or stamp_ns - self._ground_stamp_ns < GROUND_PERIOD_S * 1e9:
            return
        self._ground_stamp_ns = stamp_ns
        self._correct(Z, ground_m - float(self._state[Z]), GROUND_SIGMA_M**2)

    def _correct(self, i: int, innovation: float, variance: float) -> None:
        """Kalman correction of one directly measured state; independent measurements may be taken one by one."""
        column = self._P[:, i].copy()
        gain = column / (column[i] + variance)
        self._state += gain * innovation
        self._P -= gain[:, None] * column
