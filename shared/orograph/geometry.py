"""Rotations, and the laser's ray directions.

`R_a_b` turns a vector of frame b into frame a. Robot frame: x ahead, y left, z up, origin on the ground under the
body's centre. R = Rz(yaw) Ry(pitch) Rx(roll). The laser sits straight above the origin, axes parallel to the robot's.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from orograph.arrays import F32, F64

if TYPE_CHECKING:
    from orograph.scenario import LaserSpec


def rotation(roll_rad: float, pitch_rad: float, yaw_rad: float) -> F64:
    """R_map_robot (3, 3) from roll, pitch, yaw."""
    cr, sr = math.cos(roll_rad), math.sin(roll_rad)
    cp, sp = math.cos(pitch_rad), math.sin(pitch_rad)
    cy, sy = math.cos(yaw_rad), math.sin(yaw_rad)
    return np.array(
        [
            [cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr],
            [sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr],
            [-sp, cp * sr, cp * cr],
        ]
    )


def roll_pitch_yaw(R: F64) -> tuple[float, float, float]:
    """Inverse of `rotation` for |pitch| < pi / 2."""
    roll = math.atan2(R[2, 1], R[2, 2])
    pitch = math.asin(min(1.0, max(-1.0, -R[2, 0])))
    return roll, pitch, math.atan2(R[1, 0], R[0, 0])


def quaternion(R: F64) -> F64:
    """Unit quaternion (w, x, y, z), w >= 0, of a rotation matrix (largest-component method)."""
    m = np.array([1 + R[0, 0] + R[1, 1] + R[2, 2], 1 + R[0, 0] - R[1, 1] - R[2, 2],
                  1 - R[0, 0] + R[1, 1] - R[2, 2], 1 - R[0, 0] - R[1, 1] + R[2, 2]])  # fmt: skip
    i = int(np.argmax(m))
    w, x, y, z = R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1], m[i]
    a, b, c = R[0, 1] + R[1, 0], R[0, 2] + R[2, 0], R[1, 2] + R[2, 1]
    q = np.array([(z, w, x, y), (w, z, a, b), (x, a, z, c), (y, b, c, z)][i]) / (2 * math.sqrt(m[i]))
    return q if q[0] >= 0 else -q


def rotation_from_quaternion(q_wxyz: npt.ArrayLike) -> F64:
    """Rotation matrix (3, 3) of a unit quaternion."""
    w, x, y, z = np.asarray(q_wxyz, np.float64)
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    )


def wrap_angle(angle_rad: float) -> float:
    """The same angle in [-pi, pi)."""
    return (angle_rad + math.pi) % (2 * math.pi) - math.pi


def ray_directions(laser: LaserSpec) -> F32:
    """Unit directions (rings, columns, 3), laser frame: rings bottom to top, columns counter-clockwise from ahead."""
    elevation = np.radians(np.linspace(laser.elevation_min_deg, laser.elevation_max_deg, laser.rings))[:, None]
    azimuth = (2 * np.pi / laser.columns * np.arange(laser.columns))[None, :]
    shape = (laser.rings, laser.columns)
    x, y = np.cos(elevation) * np.cos(azimuth), np.cos(elevation) * np.sin(azimuth)
    z = np.broadcast_to(np.sin(elevation), shape)
    return np.stack([x, y, z], axis=-1).astype(np.float32)


def laser_position_m(laser: LaserSpec, R_map_robot: F64, position_m: F64) -> F64:
    """Origin (3,) of the rays in the map frame: straight above the robot's own origin."""
    return np.asarray(position_m + R_map_robot[:, 2] * laser.height_above_base_m, np.float64)
