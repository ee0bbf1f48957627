"""nuScenes: `.pcd.bin` of (x, y, z, intensity, ring), the stamp in the file's name [us]."""

from __future__ import annotations

from pathlib import Path

from orograph.importers.scans.names import stamp_of_name
from orograph.importers.scans.scan import Scan, records


def read(path: Path) -> Scan:
    """One .pcd.bin file; raises ScanError."""
    return Scan(records(path, 5, "<f4")[:, :3], stamp_of_name(path))
