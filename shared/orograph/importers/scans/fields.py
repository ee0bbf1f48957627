"""Which fields of a cloud are coordinates and which is time, whatever its driver calls them."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from orograph.arrays import I64
from orograph.importers.scans.scan import Points, Scan, ScanError

TIMES = ("t", "time", "timestamp", "time_stamp", "timestamps", "offset_time", "ts", "gps_time")
"""What drivers of Ouster, Velodyne, Hesai, Livox, RoboSense and writers of PCD call a point's time."""
SPAN_MAX = {1: 10**9, 10**3: 10**6, 10**6: 10**3, 10**9: 1}
"""Nanoseconds of a unit of time -> the most of it that a scan takes: a scan lasts a second at most."""


def scan_of_fields(where: Path | str, table: npt.NDArray[Any], stamp_ns: int | None) -> Scan:
    """A scan from a structured array (n,) of a cloud's fields; raises ScanError without x, y, z."""
    names = {name.lower(): name for name in table.dtype.names or ()}
    missing = [axis for axis in "xyz" if axis not in names]
    if missing:
        raise ScanError(f"{where}: no field {', '.join(missing)}; it has {', '.join(names) or 'none'}")
    points = _side_by_side(table, [names[axis] for axis in "xyz"])
    named = next((names[name] for name in TIMES if name in names), None)
    times = None if named is None else times_ns(table[named], stamp_ns)
    if times is None:
        return Scan(points, stamp_ns)
    first_ns, point_ns = times
    return Scan(points, first_ns if stamp_ns is None else stamp_ns, point_ns)


def beside(columns: Mapping[str, npt.NDArray[Any]]) -> npt.NDArray[Any]:
    """Columns (n,) by name as a structured array (n,)."""
    table = np.empty(len(next(iter(columns.values()))), [(name, column.dtype) for name, column in columns.items()])
    for name, column in columns.items():
        table[name] = column
    return table


def _side_by_side(table: npt.NDArray[Any], names: list[str]) -> Points:
    kind = np.result_type(*(table.dtype[name] for name in names), np.float32)
    points = np.empty((len(table), 3), kind)
    for i, name in enumerate(names):
        points[:, i] = table[name]
    return points


def times_ns(times: npt.NDArray[Any], stamp_ns: int | None) -> tuple[int | None, I64] | None:
    """(time of the first point, if absolute; time of each point (n,) after the stamp) [ns]; None without a time in it.

    The unit is the one by which a scan lasts longer than a thousandth of a second and no longer than one.
    """
    if not len(times) or times.dtype.kind not in "fiu" or not np.isfinite(times).all():
        return None
    first, last = times.min(), times.max()
    span = float(last) - float(first)
    unit = next((ns for ns in sorted(SPAN_MAX, reverse=True) if span <= SPAN_MAX[ns]), None)
    if unit is None or span * unit < 1e6:
        return None
    from_the_stamp_on = float(first) * unit < 1e15 and stamp_ns is not None
    if from_the_stamp_on or first == 0:
        return None, _whole(times, unit)
    first_ns = int(first) * unit if times.dtype.kind != "f" else round(float(first) * unit)
    return first_ns, _whole(times - first, unit) + (0 if stamp_ns is None else first_ns - stamp_ns)


def _whole(times: npt.NDArray[Any], unit: int) -> I64:
    if times.dtype.kind == "f":
        return (times.astype(np.float64) * unit).astype(np.int64)
    return times.astype(np.int64) * unit
