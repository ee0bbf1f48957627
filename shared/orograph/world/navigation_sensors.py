"""What a robot's GPS, IMU and wheel odometry say: the truth plus noise, drawn per (robot, sensor, frame)."""

from __future__ import annotations

import math
from dataclasses import dataclass

from orograph.arrays import F64
from orograph.fields import saturated
from orograph.geometry import roll_pitch_yaw, wrap_angle
from orograph.messages import Sensors
from orograph.randomness import stream
from orograph.scenario import Scenario

GPS_NONE, GPS_SINGLE = 0, 1


@dataclass(frozen=True, eq=False)
class Motion:
    """The truth of one robot at the end of a frame, and on average over it."""

    position_m: F64
    """(3,)"""
    R_map_robot: F64
    """(3, 3)"""
    yaw_rate_radps: float
    odometry_mps: float
    """Speed by the wheels."""


class NavigationSensors:
    """One robot's sensors; the scale error of its odometry is drawn once."""

    def __init__(self, scenario: Scenario, seed: int, robot: str) -> None:
        self._spec, self._seed, self._robot = scenario.navigation_sensors, seed, robot
        self._scale = 1.0 + self._spec.odometry_scale * self._noise("odometry-scale", 0, 1)[0]

    def read(self, motion: Motion, gps_quality: int, stamp_ns: int, frame: int) -> Sensors:
        """One message; without GPS (`gps_quality` 0) the position is 0."""
        x, y, z = self._gps(motion.position_m, gps_quality, frame)
        roll, pitch, yaw, yaw_rate = self._imu(motion, frame)
        return saturated(
            Sensors, stamp_ns=stamp_ns, gps_quality=gps_quality, gps_x_m=x, gps_y_m=y, gps_z_m=z, roll_rad=roll,
            pitch_rad=pitch, yaw_rad=yaw, yaw_rate_radps=yaw_rate,
            odometry_v_mps=self._odometry(motion.odometry_mps, frame),
        )  # fmt: skip

    def _gps(self, position_m: F64, quality: int, frame: int) -> tuple[float, float, float]:
        if quality == GPS_NONE:
            return 0.0, 0.0, 0.0
        sigma_m = self._spec.gps_single_m if quality == GPS_SINGLE else self._spec.gps_differential_m
        east, north, up = self._noise("gps", frame, 3) * sigma_m
        return position_m[0] + east, position_m[1] + north, position_m[2] + up * self._spec.gps_height_factor

    def _imu(self, motion: Motion, frame: int) -> tuple[float, float, float, float]:
        noise = self._noise("imu", frame, 4)
        roll, pitch, yaw = roll_pitch_yaw(motion.R_map_robot)
        attitude, heading = math.radians(self._spec.attitude_deg), math.radians(self._spec.heading_deg)
        yaw_rate = motion.yaw_rate_radps + noise[3] * self._spec.yaw_rate_radps
        return roll + noise[0] * attitude, pitch + noise[1] * attitude, wrap_angle(yaw + noise[2] * heading), yaw_rate

    def _odometry(self, v_mps: float, frame: int) -> float:
        noise = self._noise("odometry", frame, 1)[0] * self._spec.odometry_mps
        return float(v_mps * self._scale + noise)

    def _noise(self, purpose: str, frame: int, count: int) -> F64:
        """Standard normal draws."""
        return stream(self._seed, "world", self._robot, purpose, frame=frame).standard_normal(count)
