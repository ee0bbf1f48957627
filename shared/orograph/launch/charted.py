"""A folder's map with its place on Earth, whoever made the folder."""

from __future__ import annotations

from pathlib import Path

from orograph.errors import InputError
from orograph.exporters.chart import Chart
from orograph.scenario import Scenario
from orograph.storage.recorded_map import MapInfo, read_map
from orograph.storage.results import RunInfo
from orograph.storage.run_folder import GLRM, MAP, MAP_INFO, SCENARIO, FolderError, read_text


def chart_of(folder: Path, name: str | None, crs: str) -> tuple[str, Chart]:
    """The map's name and the map; `crs` overrules the folder's. Raises InputError."""
    recorded = (folder / MAP_INFO).is_file()
    name = name or Path(MAP if recorded else GLRM).stem
    path = folder / f"{name}.npz"
    if not path.is_file():
        held = ", ".join(sorted(p.stem for p in folder.glob("*.npz"))) or "none"
        raise InputError(f"{folder}: no map {name}; it holds {held}: is it the folder of a finished run?")
    try:
        if recorded:
            return name, Chart(read_map(path), crs or MapInfo.read(folder).crs)
        scenario = Scenario.model_validate_json(read_text(folder, SCENARIO))
        place = (0.0, 0.0) if crs else scenario.crs_origin_m
        end_ns = round(RunInfo.read(folder).sim_time_s * 1e9)
        return name, Chart(read_map(path), crs or scenario.crs, place, end_ns)
    except FolderError as error:
        raise InputError(str(error)) from None
