"""Scans with poses: each one's points in the map frame, as if the sensor had stood still while it turned."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from orograph.arrays import F64
from orograph.importers.scans import kitti
from orograph.importers.scans.placing_kernels import place
from orograph.importers.scans.scan import Points, Scan, ScanError, ScanFiles, Scans
from orograph.importers.scans.trajectory import KITTI, PERIOD_NS, Trajectory, pose_lines, tum
from orograph.importers.scans.trajectory import kitti as of_camera

KNOT_NS = 2_000_000
"""A sensor's way within a scan is cut into pieces of 2 ms: at 3 rad/s they are straight to 0.4 mm at 80 m."""


@dataclass(frozen=True, eq=False)
class Placed:
    """A scan in the map frame."""

    points: Points
    """(n, 3) [m]."""
    ranges_m: F64
    """(n,), as measured."""
    position_m: F64
    """Of the sensor (3,), halfway through the scan."""
    stamp_ns: int
    self_box: int
    """Points left out because they were on the sensor's carrier."""


class PosedScans:
    """Scans placed by a trajectory of the carrier, by their own poses, or (one alone) at the map frame's origin."""

    def __init__(
        self, scans: Scans, trajectory: Trajectory | None, by_order: bool, T_base_sensor: F64,
        self_box_m: tuple[float, ...] = (),
    ) -> None:  # fmt: skip
        """`by_order`: the i-th pose is of the i-th scan. `self_box_m` (x0, y0, z0, x1, y1, z1) in the base frame."""
        self._scans, self._trajectory, self._by_order = scans, trajectory, by_order
        self._T_base_sensor, self._box = T_base_sensor, np.array(self_box_m, np.float64)

    def __len__(self) -> int:
        return len(self._scans)

    def __getitem__(self, index: int) -> Placed | None:
        """The scan, None where nobody knows where the sensor was; raises ScanError."""
        scan = self._scans[index]
        stamp_ns = self._stamp_ns(scan, index)
        if scan.T_map_sensor is not None and self._trajectory is None:
            return self._place(scan, stamp_ns, scan.T_map_sensor[None])
        if self._trajectory is None:
            return self._place(scan, stamp_ns, self._T_base_sensor[None])
        if self._by_order:
            return self._place(scan, stamp_ns, (self._trajectory.poses[index] @ self._T_base_sensor)[None])
        last_ns = 0 if scan.point_ns is None else int(scan.point_ns.max(initial=0))
        first_ns = 0 if scan.point_ns is None else int(scan.point_ns.min(initial=0))
        knots = stamp_ns + first_ns + KNOT_NS * np.arange(2 + (last_ns - first_ns) // KNOT_NS)
        if not self._trajectory.covers(np.array([stamp_ns + first_ns, stamp_ns + last_ns])).all():
            return None
        knots = knots if last_ns > first_ns else knots[:1]
        return self._place(scan, stamp_ns, self._trajectory.at(knots) @ self._T_base_sensor, first_ns)

    def _stamp_ns(self, scan: Scan, index: int) -> int:
        if scan.stamp_ns is not None:
            return scan.stamp_ns
        stamps = self._trajectory.stamps_ns if self._trajectory is not None and self._by_order else None
        return int(stamps[index]) if stamps is not None else index * PERIOD_NS

    def _place(self, scan: Scan, stamp_ns: int, T_map_sensor: F64, first_ns: int = 0) -> Placed:
        points = scan.points
        xyz, ranges_m = np.empty((3, len(points))), np.empty(len(points))
        R, p = np.ascontiguousarray(T_map_sensor[:, :3, :3]), np.ascontiguousarray(T_map_sensor[:, :3, 3])
        point_ns = np.zeros(0, np.int64) if scan.point_ns is None or len(R) < 2 else scan.point_ns - first_ns
        R_bs, p_bs = (np.ascontiguousarray(part) for part in (self._T_base_sensor[:3, :3], self._T_base_sensor[:3, 3]))
        kept = place(points, point_ns, KNOT_NS, R, p, self._box, R_bs, p_bs, xyz, ranges_m)
        middle = p[len(p) // 2]
        return Placed(xyz[:, :kept].T, ranges_m[:kept], middle, stamp_ns, len(points) - kept)


def pose_scans(
    scans: Scans, source: Path, poses: Path | None, T_base_sensor: F64, self_box_m: tuple[float, ...] = ()
) -> PosedScans:
    """Scans with the poses of a file, of the recording itself, or of what KITTI lays beside; raises ScanError.

    `source` is the recording's path. Scans that no pose could be found for raise, unless there is one alone.
    """
    if not len(scans):
        raise ScanError(f"{source}: holds no scans")
    first = scans[0]
    folder = scans.files[0].parent if isinstance(scans, ScanFiles) else source.parent
    if poses is None and scans.trajectory is None and source.is_dir():
        poses = kitti.beside(folder, kitti.POSES)
    trajectory, by_order = scans.trajectory, False
    if poses is not None:
        trajectory, by_order = _of_file(poses, scans, first, folder)
    if trajectory is None and first.T_map_sensor is None and len(scans) > 1:
        raise ScanError(
            f"{source}: {len(scans)} scans and no poses: give --poses FILE (TUM or KITTI), or --frame map where the "
            "points are in one frame already"
        )
    if trajectory is not None and not by_order:
        _overlapping(scans, first, trajectory, poses or source)
    return PosedScans(scans, trajectory, by_order, T_base_sensor, self_box_m)


def _of_file(path: Path, scans: Scans, first: Scan, folder: Path) -> tuple[Trajectory, bool]:
    """The poses of a file, and whether they go by the scans' order."""
    rows = pose_lines(path)
    by_order = rows.shape[1] == KITTI or first.stamp_ns is None
    if by_order and len(rows) != len(scans):
        cure = "a KITTI file has a line for each scan" if rows.shape[1] == KITTI else "the scans carry no stamps"
        raise ScanError(f"{path}: {len(rows)} poses for {len(scans)} scans; {cure}")
    if rows.shape[1] != KITTI:
        trajectory = tum(path, rows)
        if by_order and len(trajectory.poses) != len(rows):
            raise ScanError(f"{path}: two poses have the same time, and the scans carry no stamps to tell them apart")
        return trajectory, by_order
    calib = kitti.beside(folder, kitti.CALIBRATION)
    T_camera_laser = kitti.calibration(calib) if calib else None
    return Trajectory(np.arange(len(rows)) * PERIOD_NS, of_camera(rows, T_camera_laser)), True


def _overlapping(scans: Scans, first: Scan, trajectory: Trajectory, source: Path) -> None:
    """Raises ScanError where the clocks of the scans and of the poses have nothing in common."""
    if first.stamp_ns is None:
        raise ScanError(f"{source}: the scans carry no stamps; poses by time cannot be theirs")
    last = scans[len(scans) - 1] if isinstance(scans, ScanFiles) else first
    begin, end = first.stamp_ns, last.stamp_ns if last.stamp_ns is not None else first.stamp_ns
    apart = min(begin, end) > trajectory.stamps_ns[-1] + 10**9 or max(begin, end) < trajectory.stamps_ns[0] - 10**9
    if isinstance(scans, ScanFiles) and apart:
        told = f"{trajectory.stamps_ns[0] / 1e9:.3f} to {trajectory.stamps_ns[-1] / 1e9:.3f} s"
        raise ScanError(
            f"{source}: the clocks do not overlap: scans are of {begin / 1e9:.3f} to {end / 1e9:.3f} s, poses of {told}"
        )
