"""A map that was made of recordings, as a folder holds it: its layers, and what is to be said of them."""

from __future__ import annotations

from pathlib import Path
from typing import ClassVar, Literal

import numpy as np

from orograph.grid import Grid
from orograph.layers import KINDS, CellMap
from orograph.storage.results import Result
from orograph.storage.run_folder import MAP, MAP_INFO, FolderError, read_arrays, write_arrays


class MapInfo(Result):
    """How a map was made of recordings, and where on Earth it lies."""

    FILE: ClassVar[str] = MAP_INFO

    sources: tuple[str, ...]
    scans: int
    scans_without_pose: int
    points: int
    """That were read."""
    dropped: dict[str, int]
    """Points left out by reason."""
    cells: int
    """That anything is known of."""
    cell_m: float
    rules: str
    crs: str
    """The map frame on Earth, empty where nobody said."""
    clock_restarts: int
    recorded_s: float
    """From the first stamp to the last."""
    took_s: float
    """Reading and mapping."""
    frame: Literal["sensor", "map"]


def map_arrays(cells: CellMap) -> dict[str, np.ndarray[tuple[int, ...], np.dtype[np.generic]]]:
    """A map's layers, with where it lies [m]."""
    return {"origin_m": np.array(cells.grid.origin_m), "cell_m": np.array(cells.grid.cell_m), **dict(cells.layers())}


def write_map(out: Path, cells: CellMap) -> None:
    """The map into its folder, whole or not at all."""
    write_arrays(out / MAP, map_arrays(cells))


def read_map(path: Path) -> CellMap:
    """A map as `map_arrays` gives it; raises FolderError."""
    try:
        arrays = read_arrays(path)
        x0, y0 = (float(v) for v in arrays["origin_m"])
        layers = {name: arrays[name].astype(np.float32) for name in arrays if name in KINDS}
        rows, cols = layers["height"].shape
        grid = Grid((x0, y0), float(arrays["cell_m"]), (rows, cols))
        return CellMap(grid, {**CellMap.unknown(grid).by_name, **layers})
    except (FolderError, ValueError, KeyError, AssertionError) as error:
        why = error.__cause__ or error
        raise FolderError(f"{path}: no map that can be read ({type(why).__name__}: {why})") from None
