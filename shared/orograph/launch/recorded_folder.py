"""The folder of a map that was made of recordings: map, page, and last what is to be said of it."""

from __future__ import annotations

from pathlib import Path

from orograph.exporters.chart import Chart
from orograph.importers.scans.opened import Recording
from orograph.launch.recorded import Mapped
from orograph.report.recorded import render_map
from orograph.storage.recorded_map import MapInfo, write_map
from orograph.storage.run_folder import REPORT, write_whole


def write_folder(out: Path, mapped: Mapped, recordings: list[Recording], rules: str, crs: str) -> MapInfo:
    """Write it all; `crs` overrules what the recordings say."""
    told = mapped.told
    info = MapInfo(
        sources=tuple(name for name, _, _ in recordings), scans=told.scans, scans_without_pose=told.without_pose,
        points=told.points, dropped=mapped.dropped, cells=int(Chart(mapped.cells).known.sum()),
        cell_m=mapped.cells.grid.cell_m, rules=rules, crs=crs or recordings[0][1].crs,
        clock_restarts=mapped.clock_restarts, recorded_s=mapped.recorded_s, took_s=mapped.took_s,
        frame="map" if recordings[0][1].in_map else "sensor",
    )  # fmt: skip
    write_map(out, mapped.cells)
    write_whole(out / REPORT, render_map(mapped.cells, mapped.path_m, info))
    info.write(out)
    return info
