"""Cell values side by side: rows of the mapped layers, in the order of `layers.MAPPED`, as the kernels hold them.

Touching a cell costs a cache line or two; `CellMap` keeps the same numbers layer by layer.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from orograph.grid import Grid
from orograph.layers import KINDS, MAPPED, MAPPED_LAYERS, CellMap, Layer, holds_nothing

Values = npt.NDArray[np.float32]
Ticks = npt.NDArray[np.uint32]
Cells = npt.NDArray[np.int64]
Given = tuple[Layer, Layer]
"""The layers (gps_quality, communications)."""

UNKNOWN = np.array([kind.blank for kind in MAPPED], np.float32)


def unknown_values(count: int) -> Values:
    """Values (count, WIDTH) of cells of which nothing is known."""
    return np.tile(UNKNOWN, (count, 1))


def values_of(cell_map: CellMap) -> Values:
    """Values (rows * cols, WIDTH) of a map, row by row."""
    values = unknown_values(cell_map.grid.size)
    for i, name in enumerate(MAPPED_LAYERS):
        if name in cell_map.by_name:
            values[:, i] = cell_map.by_name[name].reshape(-1)
    return values


def map_of(values: Values, grid: Grid, given: Given | None = None) -> CellMap:
    """A map over `grid` from values (grid.size, WIDTH); without given layers: no GPS, communications everywhere.

    Layers that are not basic are left out where they hold nothing.
    """
    gps_quality, communications = given or (np.zeros(grid.shape, np.float32), np.ones(grid.shape, np.float32))
    mapped = {
        kind.name: values[:, i].reshape(grid.shape).copy()
        for i, kind in enumerate(MAPPED)
        if kind.basic or not holds_nothing(kind, values[:, i])
    }
    return CellMap(grid, {"gps_quality": gps_quality.copy(), "communications": communications.copy(), **mapped})


def cut(cell_map: CellMap, row: int, col: int, shape: tuple[int, int]) -> CellMap:
    """The rectangle of `shape` cells from (row, col) on; it may hang over the edge, where nothing is known."""
    grid = cell_map.grid.window(row, col, shape)
    out = CellMap(grid, {name: np.full(shape, KINDS[name].blank, np.float32) for name in cell_map.by_name})
    rows, cols = slice(max(row, 0), row + shape[0]), slice(max(col, 0), col + shape[1])
    for (_, layer), (_, source) in zip(out.layers(), cell_map.layers(), strict=True):
        part = source[rows, cols]
        r, c = rows.start - row, cols.start - col
        layer[r : r + part.shape[0], c : c + part.shape[1]] = part
    return out
