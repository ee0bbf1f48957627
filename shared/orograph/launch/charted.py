"""A folder's map with its place on Earth, whoever made the folder."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from orograph import keys
from orograph.errors import InputError
from orograph.exporters.chart import Chart
from orograph.layers import CellMap
from orograph.mapping.cells import map_of, values_of
from orograph.messages import Packed
from orograph.nodes.cell_history import CHANGE, newest
from orograph.registers import unpack, values
from orograph.storage.parts import read_parts, read_scenario
from orograph.storage.recorded_map import MapInfo, read_map
from orograph.storage.results import RunInfo
from orograph.storage.run_folder import GLRM, MAP, MAP_INFO

TIMES_MAX = 1000


def course_of(folder: Path, every_s: float, crs: str) -> tuple[str, list[Chart]]:
    """The name of a run's global map and the map each `every_s` until its end; raises InputError."""
    name, last = chart_of(folder, None, crs)
    manager = read_parts(folder).of(keys.MANAGER) if name == Path(GLRM).stem else {}
    if "changes" not in manager or manager["changes"].dtype != CHANGE:
        raise InputError(f"--every: {folder} keeps no course of its map; a run of this version does")
    times_ns = [*range(0, last.stamp_ns, round(every_s * 1e9)), last.stamp_ns]
    if len(times_ns) > TIMES_MAX:
        raise InputError(f"--every {every_s:g}: {len(times_ns)} times, at most {TIMES_MAX}")
    return name, [
        replace(last, cells=_map_at(last.cells, manager["prior"], manager["changes"], at), stamp_ns=at)
        for at in times_ns
    ]


def _map_at(last: CellMap, prior: Packed, changes: Packed, stamp_ns: int) -> CellMap:
    """The map as it was: the prior, and of each cell the newest change until then."""
    so_far = changes[changes["stamp_ns"] <= stamp_ns]
    held = values_of(unpack(prior, last.grid))
    if len(so_far):
        held[newest([so_far])["cell"]] = values(newest([so_far]))
    return map_of(held, last.grid, (last.gps_quality, last.communications))


def chart_of(folder: Path, name: str | None, crs: str) -> tuple[str, Chart]:
    """The map's name and the map; `crs` overrules the folder's. Raises InputError."""
    recorded = (folder / MAP_INFO).is_file()
    name = name or Path(MAP if recorded else GLRM).stem
    path = folder / f"{name}.npz"
    if not path.is_file():
        held = ", ".join(sorted(p.stem for p in folder.glob("*.npz"))) or "none"
        raise InputError(f"{folder}: no map {name}; it holds {held}: is it the folder of a finished run?")
    if recorded:
        return name, Chart(read_map(path), crs or MapInfo.read(folder).crs)
    scenario = read_scenario(folder)
    place = (0.0, 0.0) if crs else scenario.crs_origin_m
    end_ns = round(RunInfo.read(folder).sim_time_s * 1e9)
    return name, Chart(read_map(path), crs or scenario.crs, place, end_ns)
