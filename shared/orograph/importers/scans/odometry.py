"""Poses from the scans themselves, where nobody recorded any: KISS-ICP (Vizzo et al., 2023)."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from orograph.arrays import F64
from orograph.importers.scans.scan import Scan, Scans
from orograph.importers.scans.trajectory import PERIOD_NS, Trajectory

OnScan = Callable[[int, int], None]
"""Called with how many scans are done, and of how many."""


def by_kiss_icp(
    scans: Scans, T_base_sensor: F64, range_min_m: float, range_max_m: float, on_scan: OnScan
) -> Trajectory:  # fmt: skip
    """Poses of the sensor's carrier, a pose a scan, in its frame at the first; they drift with the way.

    Stamps are the scans', of the last point where points carry times; PERIOD_NS apart where there are none. Raises
    ScanError where a scan cannot be read.
    """
    from kiss_icp.config import KISSConfig
    from kiss_icp.config.config import DataConfig, MappingConfig, RegistrationConfig
    from kiss_icp.kiss_icp import KissICP

    # One thread: sums come out the same every time.
    odometry = KissICP(KISSConfig(
        data=DataConfig(min_range=range_min_m, max_range=range_max_m, deskew=True),
        mapping=MappingConfig(voxel_size=range_max_m / 100), registration=RegistrationConfig(max_num_threads=1),
    ))  # fmt: skip
    stamps_ns, poses = [], []
    back = np.linalg.inv(T_base_sensor)
    for i in range(len(scans)):
        scan = scans[i]
        points, times, pose_ns = _frame(scan)
        odometry.register_frame(points, times)
        poses.append(T_base_sensor @ odometry.last_pose @ back)
        stamps_ns.append((i * PERIOD_NS if scan.stamp_ns is None else scan.stamp_ns) + pose_ns)
        on_scan(i + 1, len(scans))
    return Trajectory(stamps_ns, poses)


def _frame(scan: Scan) -> tuple[F64, F64, int]:
    """Finite points (n, 3), their times as shares of the scan (n,) or (0,), and when the pose will be of [ns]."""
    finite = np.isfinite(scan.points).all(axis=1)
    points = np.ascontiguousarray(scan.points[finite], np.float64)
    if scan.point_ns is None or not len(points):
        return points, np.zeros(0), 0
    times_ns = scan.point_ns[finite]
    first_ns, last_ns = int(times_ns.min()), int(times_ns.max())
    return points, (times_ns - first_ns) / max(last_ns - first_ns, 1), last_ns
