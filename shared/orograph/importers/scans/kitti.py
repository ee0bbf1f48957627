"""KITTI: `.bin` of (x, y, z, reflectance), times and calibration in text beside the folder of scans."""

from __future__ import annotations

from datetime import UTC, datetime
from pathlib import Path

import numpy as np

from orograph.arrays import F64, I64
from orograph.importers.scans.scan import Scan, ScanError, records

TIMES, CALIBRATION, POSES = ("times.txt", "timestamps.txt"), ("calib.txt",), ("poses.txt",)


def read(path: Path) -> Scan:
    """One .bin file; raises ScanError."""
    return Scan(records(path, 4, "<f4")[:, :3])


def beside(folder: Path, names: tuple[str, ...]) -> Path | None:
    """A file of one of these names in the folder of scans or the one above, None where there is none."""
    return next((place / name for place in (folder, folder.parent) for name in names if (place / name).is_file()), None)


def stamps_ns(folder: Path, scans: int) -> I64 | None:
    """Stamps (scans,) from times.txt [s] or timestamps.txt (dates), None without such a file; raises ScanError."""
    path = beside(folder, TIMES)
    if path is None:
        return None
    lines = [line for line in path.read_text(errors="replace").splitlines() if line.strip()]
    if len(lines) != scans:
        raise ScanError(f"{path}: {len(lines)} times for {scans} scans; take away what is too many")
    try:
        return np.array([_stamp_ns(line.strip()) for line in lines], np.int64)
    except ValueError as error:
        raise ScanError(f"{path}: expected seconds or dates, one a line: {error}") from None


def _stamp_ns(text: str) -> int:
    if "-" not in text[1:5]:
        return round(float(text) * 1e9)
    date, _, fraction = text.partition(".")
    whole = datetime.fromisoformat(date).replace(tzinfo=UTC)
    return int(whole.timestamp()) * 10**9 + int(f"{fraction:0<9}"[:9])


def calibration(path: Path) -> F64:
    """`Tr` or `Tr_velo_to_cam` (4, 4) of a calib.txt: from the laser's frame to the camera's; raises ScanError."""
    for line in path.read_text(errors="replace").splitlines():
        name, _, rest = line.partition(":")
        if name.strip() in ("Tr", "Tr_velo_to_cam", "Tr_velo_cam"):
            try:
                return np.vstack([np.array(rest.split(), np.float64).reshape(3, 4), [0, 0, 0, 1]])
            except ValueError:
                raise ScanError(f"{path}: {name}: expected 12 numbers, found {rest.strip()[:60]!r}") from None
    raise ScanError(f"{path}: no line Tr (from the laser to the camera that the poses are of)")
