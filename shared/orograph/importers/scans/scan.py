"""What a recording holds: scans in the sensor's frame, each with its time and, where it is told, its pose."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np
import numpy.typing as npt

from orograph.arrays import F64, I64
from orograph.errors import InputError

if TYPE_CHECKING:
    from orograph.importers.scans.trajectory import Trajectory

Points = npt.NDArray[Any]


class ScanError(InputError):
    """A recording that cannot be read; the message names the file, the field and the cure."""


@dataclass(frozen=True, eq=False)
class Scan:
    """One scan as it was recorded."""

    points: Points
    """(n, 3) [m] in the sensor's frame; in the map frame where the recording is `in_map`."""
    stamp_ns: int | None = None
    point_ns: I64 | None = None
    """When each point (n,) was measured, from the stamp on."""
    T_map_sensor: F64 | None = None
    """Pose (4, 4) at the stamp, where the file itself tells."""


class Scans(Protocol):
    """A recording, one scan after the other."""

    in_map: bool
    """Points are already in one map frame, as surveyors give them; then there are no rays."""
    trajectory: Trajectory | None
    """Poses of the sensor's carrier by time, where the recording holds them."""
    crs: str
    """The map frame on Earth, empty where the recording does not say."""
    note: str
    """What was taken for granted, empty for nothing."""

    def __len__(self) -> int: ...

    def __getitem__(self, index: int) -> Scan:
        """Raises ScanError."""


class ScanFiles:
    """One scan a file, in the order of the names."""

    trajectory: Trajectory | None = None
    crs = note = ""

    def __init__(self, files: list[Path], read: Callable[[Path], Scan], stamps_ns: I64 | None, in_map: bool) -> None:
        """`read` gives a file's scan; `stamps_ns` (files,) are told beside the files."""
        self.files, self._read, self._stamps_ns, self.in_map = files, read, stamps_ns, in_map

    def __len__(self) -> int:
        return len(self.files)

    def __getitem__(self, index: int) -> Scan:
        path = self.files[index]
        try:
            scan = self._read(path)
        except OSError as error:
            raise ScanError(f"{path}: cannot be read ({error.strerror or error})") from None
        if self._stamps_ns is not None:
            return replace(scan, stamp_ns=int(self._stamps_ns[index]))
        return scan


def first_line(error: Exception) -> str:
    """What an error says, to be put in a line."""
    return next(iter(str(error).splitlines()), type(error).__name__)


def records(path: Path, columns: int, dtype: str) -> Points:
    """Rows (n, columns) of a file that is nothing but numbers of `dtype`; raises ScanError where they do not fit."""
    size, row = path.stat().st_size, np.dtype(dtype).itemsize * columns
    if size == 0 or size % row:
        raise ScanError(f"{path}: {size} bytes are not rows of {columns} numbers {dtype}; cut off, or another --format")
    rows = np.fromfile(path, dtype).reshape(-1, columns)
    if not np.isfinite(rows[:1, :3]).all() or float(np.nanmax(np.abs(rows[: 10**5, :3]), initial=0.0)) > 1e7:
        raise ScanError(f"{path}: holds no coordinates [m] as rows of {columns} numbers {dtype}; try another --format")
    return rows
