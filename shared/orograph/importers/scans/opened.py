"""Recordings as they were named, opened and placed: what is wrong with any of them is said before work begins."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from orograph.arrays import F64
from orograph.importers.scans.formats import open_scans
from orograph.importers.scans.posed import PosedScans, pose_scans
from orograph.importers.scans.scan import ScanError, Scans
from orograph.importers.scans.trajectory import sensor_pose

Recording = tuple[str, Scans, PosedScans]


def open_recordings(
    sources: Sequence[Path], poses: Path | None, form: str | None, topic: str | None, in_map: bool | None,
    T_base_sensor: str, self_box_m: tuple[float, ...],
) -> list[Recording]:  # fmt: skip
    """(name, scans, the same with poses) of each source; raises ScanError."""
    mount = sensor_pose(T_base_sensor)
    opened = [(source, open_scans(source, form, topic, in_map, poses is not None)) for source in sources]
    if poses is not None and len(opened) > 1:
        raise ScanError(f"--poses {poses}: of one recording, {len(opened)} were given; put the scans into one folder")
    frames = {scans.in_map for _, scans in opened}
    if len(frames) > 1:
        raise ScanError("some sources are in their sensor's frame and some in a map's; say which by --frame")
    return [(str(source), scans, _posed(scans, source, poses, mount, self_box_m)) for source, scans in opened]


def _posed(
    scans: Scans, source: Path, poses: Path | None, mount: F64, self_box_m: tuple[float, ...]
) -> PosedScans:  # fmt: skip
    if scans.in_map:
        return PosedScans(scans, None, False, mount, self_box_m)
    return pose_scans(scans, source, poses, mount, self_box_m)
