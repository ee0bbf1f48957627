"""LAS and LAZ: surveyed points in one frame on Earth, a million at a time."""

from __future__ import annotations

import math
import struct
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np

from orograph.importers.scans.scan import Scan, ScanError
from orograph.importers.scans.trajectory import Trajectory

CHUNK_BYTES = 2**26
"""Points are unpacked so much at a time: a million and more of the usual ones."""
METRE = 1.0
PACKED = 0x80
"""In the point format: the points are those of a LAZ file."""


class LasFile:
    """One file as parts of CHUNK_BYTES, each with its points' coordinates in metres."""

    trajectory: Trajectory | None = None

    def __init__(self, path: Path, in_map: bool = True) -> None:
        """Raises ScanError for what is no LAS."""
        self.path, self.in_map = path, in_map
        with _opened(path) as file:
            self._points: int = int(file.header.point_count)
            self._chunk: int = max(1, CHUNK_BYTES // file.header.point_format.size)
            self.crs, self._metres, unit = _frame(path, file.header)
        self.note = f"coordinates and heights were in {unit}: brought to metres, the CRS left out" if unit else ""
        if not self._points:
            raise ScanError(f"{path}: holds no points")

    def __len__(self) -> int:
        return math.ceil(self._points / self._chunk)

    def __getitem__(self, index: int) -> Scan:
        with _opened(self.path) as file:
            try:
                if index:
                    file.seek(index * self._chunk)
                chunk = file.read_points(self._chunk)
            except (KeyboardInterrupt, SystemExit):
                raise
            except BaseException as error:  # laspy raises whatever its parts do, and a panic of lazrs is no Exception
                raise ScanError(f"{self.path}: points from {index * self._chunk} on: {error}; is it cut off?") from None
        wanted = min(self._chunk, self._points - index * self._chunk)
        if len(chunk) != wanted:
            raise ScanError(f"{self.path}: {self._points} points promised; it is cut off after {len(chunk)} of a part")
        return Scan(np.column_stack([chunk.x, chunk.y, chunk.z]) * self._metres)


def _opened(path: Path) -> Any:
    import laspy

    try:
        _sound(path)
        return laspy.open(path)
    except OSError as error:
        raise ScanError(f"{path}: cannot be read ({error.strerror or error})") from None
    except ScanError:
        raise
    except Exception as error:  # laspy raises whatever its parts raise
        raise ScanError(f"{path}: no LAS that can be read: {error}") from None


def _sound(path: Path) -> None:
    """Raises ScanError for a file that promises more records than it is long: the libraries would make room for all."""
    size = path.stat().st_size
    with path.open("rb") as stream:
        head = stream.read(375)
        if len(head) < 227:
            raise ScanError(f"{path}: no LAS that can be read: {len(head)} bytes; it is cut off")
        header_size, points_at, records = struct.unpack_from("<HII", head, 94)
        later = struct.unpack_from("<QI", head, 235) if head[25] >= 4 and len(head) == 375 else (0, 0)
        chunks = _laz_chunks(stream, points_at) if head[104] & PACKED else 0
    ends = header_size + 54 * records, points_at, later[0] + 60 * later[1], chunks
    if ends[0] > points_at or max(ends) > size:
        raise ScanError(f"{path}: no LAS that can be read: its header tells of more records than there are")


def _laz_chunks(stream: BinaryIO, points_at: int) -> int:
    """How many packed chunks there are, of which each takes a byte or more; 0 where the table is not to be found."""
    stream.seek(points_at)
    table_at = int.from_bytes(stream.read(8), "little", signed=True)
    if table_at == -1:
        stream.seek(-8, 2)
        table_at = int.from_bytes(stream.read(8), "little", signed=True)
    if table_at < 0:
        return 0
    stream.seek(table_at + 4)
    return int.from_bytes(stream.read(4), "little")


def _frame(path: Path, header: Any) -> tuple[str, float, str]:
    """(CRS where it is one of metres, its unit [m], that unit's name where it is another); degrees raise ScanError."""
    try:
        crs = header.parse_crs()
    except Exception:  # pyproj and laspy raise whatever their parts raise on odd records
        return "", METRE, ""
    if crs is None:
        return "", METRE, ""
    axis = crs.axis_info[0]
    if axis.unit_name in ("degree", "radian"):
        raise ScanError(f"{path}: coordinates are in degrees; bring them into a frame of metres, for instance UTM")
    if axis.unit_conversion_factor == METRE:
        return str(crs.to_wkt()), METRE, ""
    return "", float(axis.unit_conversion_factor), str(axis.unit_name)
