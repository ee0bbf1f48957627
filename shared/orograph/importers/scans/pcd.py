"""PCD of the Point Cloud Library: ascii, binary and compressed."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from orograph.importers.scans.fields import scan_of_fields
from orograph.importers.scans.names import stamp_of_name
from orograph.importers.scans.scan import Scan, ScanError, first_line


def read(path: Path) -> Scan:
    """One .pcd file; raises ScanError."""
    from pypcd4.pypcd4 import PointCloud

    try:
        cloud = PointCloud.from_path(path)
    except OSError:
        raise
    except Exception as error:  # pypcd4 raises whatever its parts raise
        raise ScanError(f"{path}: no PCD that can be read: {first_line(error)}; is it cut off?") from None
    told, table = cloud.metadata.points, np.atleast_1d(cloud.pc_data)
    if len(table) != told:
        raise ScanError(f"{path}: POINTS says {told}, {len(table)} are there; it is cut off")
    return scan_of_fields(path, table, stamp_of_name(path))
