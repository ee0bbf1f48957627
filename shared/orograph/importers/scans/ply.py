"""PLY: the vertices, ascii or binary of either byte order."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from orograph.importers.scans.fields import beside, scan_of_fields
from orograph.importers.scans.names import stamp_of_name
from orograph.importers.scans.scan import Scan, ScanError


def read(path: Path) -> Scan:
    """One .ply file; raises ScanError."""
    from trimesh.exchange.ply import load_ply

    try:
        with path.open("rb") as stream:
            loaded = load_ply(stream)
        table = loaded["metadata"]["_ply_raw"]["vertex"]["data"]
        told = loaded["metadata"]["_ply_raw"]["vertex"]["length"]
    except OSError:
        raise
    except Exception as error:  # trimesh raises whatever its parts raise
        raise ScanError(f"{path}: no PLY that can be read: {str(error)[:80]}; is it cut off?") from None
    if not isinstance(table, np.ndarray):
        table = beside({name: np.asarray(column).reshape(-1) for name, column in table.items()})
    if len(table) != told:
        raise ScanError(f"{path}: the header says {told} vertices, {len(table)} are there; it is cut off")
    return scan_of_fields(path, table, stamp_of_name(path))
