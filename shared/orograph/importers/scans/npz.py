"""NPZ: `points` (n, 3), and perhaps `stamp_ns`, `point_ns` (n,), and `T_map_sensor` (4, 4) or `position_m` (3,)."""

from __future__ import annotations

import zipfile
import zlib
from pathlib import Path
from typing import Any

import numpy as np

from orograph.importers.scans.names import stamp_of_name
from orograph.importers.scans.scan import Scan, ScanError


def read(path: Path) -> Scan:
    """One .npz file; points with `position_m` alone are in the map frame, seen from there. Raises ScanError."""
    try:
        with path.open("rb") as stream, np.load(stream, allow_pickle=False) as file:
            held = {name: file[name] for name in file.files}
    except (ValueError, EOFError, zipfile.BadZipFile, zlib.error, KeyError, NotImplementedError) as error:
        raise ScanError(f"{path}: no npz that can be read: {error}") from None
    if "points" not in held:
        raise ScanError(f"{path}: no array points (n, 3); it has {', '.join(held) or 'none'}")
    points = held["points"]
    if points.ndim < 2 or points.shape[-1] < 3 or points.dtype.kind not in "fiu":
        raise ScanError(f"{path}: points: expected numbers (n, 3) [m], found {points.shape} of {points.dtype}")
    points = points.reshape(-1, points.shape[-1])[:, :3]
    stamp_ns = int(_shaped(path, held, "stamp_ns", 1)[0]) if "stamp_ns" in held else stamp_of_name(path)
    point_ns = _shaped(path, held, "point_ns", len(points)).astype(np.int64) if "point_ns" in held else None
    if "T_map_sensor" in held:
        return Scan(points, stamp_ns, point_ns, _shaped(path, held, "T_map_sensor", 16).reshape(4, 4))
    if "position_m" not in held:
        return Scan(points, stamp_ns, point_ns)
    pose = np.eye(4)
    pose[:3, 3] = _shaped(path, held, "position_m", 3)
    return Scan(points - pose[:3, 3], stamp_ns, None, pose)


def _shaped(path: Path, held: dict[str, Any], name: str, numbers: int) -> Any:
    array = held[name]
    if array.dtype.kind not in "fiu" or array.size != numbers or not np.isfinite(array).all():
        raise ScanError(f"{path}: {name}: expected {numbers} numbers, found {array.shape} of {array.dtype}")
    return array.reshape(-1).astype(np.float64) if name != "stamp_ns" else array.reshape(-1)
