"""Poses by time, from the files that odometry and SLAM write: TUM (time, position, quaternion) and KITTI (3 x 4)."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from pathlib import Path

import numpy as np
import numpy.typing as npt

from orograph.arrays import F64, I64, Mask
from orograph.geometry import rotation
from orograph.importers.scans.scan import ScanError

REACH_NS = 200_000_000
"""A scan may begin or end so long before the first pose or after the last: the nearest pose holds."""
GAP_NS = 2_000_000_000
"""Between poses further apart nobody knows where the sensor was."""
PERIOD_NS = 100_000_000
"""Time between scans of which no stamp is known."""
TUM, KITTI = 8, 12
"""Numbers in a line."""


class Trajectory:
    """Poses `T_map_base` of what carries the sensor, by ascending time; between two of them it moves evenly."""

    def __init__(self, stamps_ns: npt.ArrayLike, T_map_base: npt.ArrayLike) -> None:
        """Stamps (n,) [ns], n > 0, in any order, and poses (n, 4, 4)."""
        stamps, poses = np.asarray(stamps_ns, np.int64), np.asarray(T_map_base, np.float64)
        assert len(stamps) == len(poses) > 0 and poses.shape[1:] == (4, 4), (stamps.shape, poses.shape)
        self.stamps_ns, first = np.unique(stamps, return_index=True)
        self.poses: F64 = poses[first]

    def covers(self, stamps_ns: I64) -> Mask:
        """Which of the stamps (n,) lie where poses tell the place."""
        after = np.searchsorted(self.stamps_ns, stamps_ns)
        before_ns = self.stamps_ns[np.maximum(after - 1, 0)]
        after_ns = self.stamps_ns[np.minimum(after, len(self.stamps_ns) - 1)]
        inside: Mask = (stamps_ns >= self.stamps_ns[0] - REACH_NS) & (stamps_ns <= self.stamps_ns[-1] + REACH_NS)
        return inside & (after_ns - before_ns <= GAP_NS)

    def at(self, stamps_ns: I64) -> F64:
        """Poses (n, 4, 4) at stamps (n,); beyond the ends the last one holds."""
        at = np.clip(stamps_ns, self.stamps_ns[0], self.stamps_ns[-1])
        if len(self.stamps_ns) == 1:
            return np.repeat(self.poses, len(at), axis=0)
        i = np.clip(np.searchsorted(self.stamps_ns, at, side="right") - 1, 0, len(self.stamps_ns) - 2)
        share = (at - self.stamps_ns[i]) / (self.stamps_ns[i + 1] - self.stamps_ns[i])
        return between(self.poses[i], self.poses[i + 1], share)


def between(first: F64, second: F64, share: F64) -> F64:
    """Poses (n, 4, 4) that have gone `share` (n,) of the way between two: along a line, about one axis."""
    from scipy.spatial.transform import Rotation

    turn = Rotation.from_matrix(np.swapaxes(first[:, :3, :3], 1, 2) @ second[:, :3, :3])
    poses = first.copy()
    poses[:, :3, :3] = first[:, :3, :3] @ Rotation.from_rotvec(turn.as_rotvec() * share[:, None]).as_matrix()
    poses[:, :3, 3] += share[:, None] * (second[:, :3, 3] - first[:, :3, 3])
    return poses


def from_quaternions(positions_m: F64, quaternions_xyzw: F64) -> F64:
    """Poses (n, 4, 4) of positions (n, 3) and quaternions (n, 4), made unit."""
    from scipy.spatial.transform import Rotation

    poses = np.tile(np.eye(4), (len(positions_m), 1, 1))
    poses[:, :3, :3] = Rotation.from_quat(quaternions_xyzw).as_matrix()
    poses[:, :3, 3] = positions_m
    return poses


def sensor_pose(text: str) -> F64:
    """T_base_sensor (4, 4) from `x,y,z` [m] and perhaps `,roll,pitch,yaw` [deg]; raises ScanError."""
    try:
        numbers = [float(word) for word in text.split(",")]
        if len(numbers) not in (3, 6) or not np.isfinite(numbers).all():
            raise ValueError
    except ValueError:
        raise ScanError(f"--sensor-pose {text}: expected x,y,z [m] or x,y,z,roll,pitch,yaw [m, deg]") from None
    pose = np.eye(4)
    pose[:3, :3] = rotation(*np.radians(numbers[3:] or [0.0, 0.0, 0.0]).tolist())
    pose[:3, 3] = numbers[:3]
    return pose


def pose_lines(path: Path) -> F64:
    """Numbers (n, 8) of a TUM file or (n, 12) of a KITTI one; raises ScanError with the line that is neither."""
    try:
        lines = path.read_text(encoding="utf-8-sig").splitlines()
    except (OSError, UnicodeDecodeError) as error:
        raise ScanError(f"--poses {path}: cannot be read ({getattr(error, 'strerror', None) or 'no text'})") from None
    rows: list[list[float]] = []
    for number, words in _told(lines):
        try:
            rows.append([float(word) for word in words])
        except ValueError:
            rows.append([])
        if len(rows[-1]) not in (TUM, KITTI) or len(rows[-1]) != len(rows[0]) or not np.isfinite(rows[-1]).all():
            wanted, found = "8 numbers (TUM: time x y z qx qy qz qw) or 12 (KITTI: 3 x 4)", lines[number - 1][:60]
            raise ScanError(f"{path}:{number}: expected {wanted}, the same in every line, found {found!r}")
    if not rows:
        raise ScanError(f"--poses {path}: holds no poses")
    return np.array(rows)


def _told(lines: Iterable[str]) -> Iterator[tuple[int, list[str]]]:
    """Number, from 1, and words of those lines that are no comments."""
    for number, line in enumerate(lines, 1):
        words = line.replace(",", " ").split()
        if words and not words[0].startswith(("#", "//", "%")):
            yield number, words


def tum(path: Path, rows: F64) -> Trajectory:
    """The trajectory of lines (n, 8): time [s or ns], position [m], quaternion x y z w; raises ScanError."""
    if (zero := np.flatnonzero(np.linalg.norm(rows[:, 4:], axis=1) < 1e-6)).size:
        raise ScanError(f"{path}: pose {zero[0] + 1}: a quaternion of zeros is no rotation")
    unit = 1 if rows[:, 0].max() > 1e14 else 1e9  # nanoseconds since 1970 or since the start; else seconds
    return Trajectory(_stamps_ns(path, unit), from_quaternions(rows[:, 1:4], rows[:, 4:8]))


def _stamps_ns(path: Path, unit: float) -> I64:
    """The first column, exactly: a float64 of Unix seconds holds no more than 0.2 us."""
    stamps = []
    for _, words in _told(path.read_text(encoding="utf-8-sig").splitlines()):
        whole, _, fraction = words[0].partition(".")
        exact = whole.lstrip("-").isdigit() and (fraction.isdigit() or not fraction)
        nanoseconds = int(f"{fraction:0<9}"[:9]) * (-1 if whole.startswith("-") else 1)
        stamps.append(int(whole) * round(unit) + (nanoseconds if unit > 1 else 0) if exact
                      else round(float(words[0]) * unit))  # fmt: skip
    return np.array(stamps, np.int64)


def kitti(rows: F64, T_camera_laser: F64 | None) -> F64:
    """Poses (n, 4, 4) of the laser, in its own first frame, from lines (n, 12) of the camera's, in the camera's."""
    poses = np.tile(np.eye(4), (len(rows), 1, 1))
    poses[:, :3] = rows.reshape(-1, 3, 4)
    if T_camera_laser is None:
        return poses
    return np.asarray(np.linalg.inv(T_camera_laser) @ poses @ T_camera_laser, np.float64)
