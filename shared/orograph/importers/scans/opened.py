"""Recordings as they were named, opened and placed: what is wrong with any of them is said before work begins."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

from orograph.arrays import F64
from orograph.importers.scans.formats import open_scans
from orograph.importers.scans.posed import PosedScans, pose_scans
from orograph.importers.scans.scan import ScanError, Scans
from orograph.importers.scans.trajectory import Trajectory

Odometry = Callable[[Scans], Trajectory]
"""Poses of a recording from its scans."""
Recording = tuple[str, Scans, PosedScans]


def open_recordings(
    sources: Sequence[Path], poses: Path | None, form: str | None, topic: str | None, in_map: bool | None,
    mount: F64, self_box_m: tuple[float, ...], odometry: Odometry | None = None,
) -> list[Recording]:  # fmt: skip
    """(name, scans, the same with poses) of each source, `mount` being T_base_sensor (4, 4); raises ScanError."""
    posed = poses is not None or odometry is not None
    opened = [(source, open_scans(source, form, topic, in_map, posed)) for source in sources]
    if poses is not None and len(opened) > 1:
        raise ScanError(f"--poses {poses}: of one recording, {len(opened)} were given; put the scans into one folder")
    frames = {scans.in_map for _, scans in opened}
    if len(frames) > 1:
        raise ScanError("some sources are in their sensor's frame and some in a map's; say which by --frame")
    if odometry is not None and len(opened) > 1:
        raise ScanError(f"--odometry: of one recording, {len(opened)} were given: nothing tells how they lie")
    return [(str(source), scans, _posed(scans, source, poses, mount, self_box_m, odometry)) for source, scans in opened]


def _posed(
    scans: Scans, source: Path, poses: Path | None, mount: F64, self_box_m: tuple[float, ...],
    odometry: Odometry | None,
) -> PosedScans:  # fmt: skip
    if scans.in_map:
        return PosedScans(scans, None, False, mount, self_box_m)
    if odometry is not None and len(scans):
        return PosedScans(scans, odometry(scans), scans[0].stamp_ns is None, mount, self_box_m)
    return pose_scans(scans, source, poses, mount, self_box_m)
