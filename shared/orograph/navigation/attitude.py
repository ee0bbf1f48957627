"""Roll and pitch, filtered as the slope of the ground under the robot in the map frame.

A robot that turns on the spot on a slope changes its roll and pitch fast, but the slope under it stays: filtered in the
map frame, the IMU's attitude noise averages out over more samples than it could in the robot's frame.
"""

from __future__ import annotations

import math

SLOPE_WALK_PER_M = 0.003
"""One sigma of the slope's change over one metre driven: what a 2 m terrain facet does to a wheelbase of 0.45 m."""
SLOPE_WALK_AT_REST = 2e-5
"""One sigma of the slope's change per sqrt(s) of a robot that stands or turns: its wheels settle."""


class SlopeFilter:
    """Two Kalman filters of one state, d(ground)/dx and d(ground)/dy, that share one variance."""

    def __init__(self, attitude_sigma_rad: float) -> None:
        self.slope_x = 0.0
        self.slope_y = 0.0
        self._ends: list[tuple[float, float]] = []
        """The slopes measured last and before, as they were."""
        self._measured_variance = attitude_sigma_rad**2
        self._variance = 1.0

    def update(self, roll_rad: float, pitch_rad: float, yaw_rad: float, moved_m: float, dt_s: float) -> None:
        """Take the IMU's roll and pitch after `moved_m` metres and `dt_s` seconds; yaw is the pose filter's."""
        self._variance += SLOPE_WALK_PER_M**2 * abs(moved_m) + SLOPE_WALK_AT_REST**2 * dt_s
        gain = self._variance / (self._variance + self._measured_variance)
        self._variance *= 1 - gain
        x, y = _slope(roll_rad, pitch_rad, yaw_rad)
        self._ends = [*self._ends[-1:], (x, y)]
        self.slope_x += gain * (x - self.slope_x)
        self.slope_y += gain * (y - self.slope_y)

    def passed(self, yaw_rad: float) -> tuple[float, float]:
        """Slope [m/m] ahead and to the left between the last two updates, by what was measured then.

        The filtered slope comes late, and a slope that comes late adds up to a wrong height.
        """
        x, y = (sum(end[i] for end in self._ends) / len(self._ends) for i in (0, 1))
        c, s = math.cos(yaw_rad), math.sin(yaw_rad)
        return x * c + y * s, y * c - x * s

    def roll_pitch(self, yaw_rad: float) -> tuple[float, float]:
        """Roll and pitch [rad] of a robot that stands on this slope with that heading (R = Rz Ry Rx)."""
        ahead = self.slope_x * math.cos(yaw_rad) + self.slope_y * math.sin(yaw_rad)
        left = -self.slope_x * math.sin(yaw_rad) + self.slope_y * math.cos(yaw_rad)
        return math.asin(left / math.sqrt(1 + ahead**2 + left**2)), -math.atan(ahead)


def _slope(roll_rad: float, pitch_rad: float, yaw_rad: float) -> tuple[float, float]:
    """Slope (d/dx, d/dy) of the plane normal to the robot's z axis."""
    up = math.cos(pitch_rad) * math.cos(roll_rad)
    ahead = -math.sin(pitch_rad) * math.cos(roll_rad) / up
    left = math.sin(roll_rad) / up
    c, s = math.cos(yaw_rad), math.sin(yaw_rad)
    return ahead * c - left * s, ahead * s + left * c
