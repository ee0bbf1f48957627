"""True driving distances over free cells: what a straight line through a block of houses would hide."""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import partial
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy.sparse import csr_array
from scipy.sparse.csgraph import connected_components, dijkstra

from orograph.arrays import F64, I64, Mask
from orograph.grid import Grid

UNREACHABLE_M = 1e6
"""Distance between places that no drive over free cells joins."""
BLOCKED = 0.95
"""Occupation from which a cell is an obstacle; unknown cells count as free."""


def _joined(free: Mask, rows: int, cols: int) -> tuple[I64, I64]:
    """Free cells (from, to), flat, that lie (rows >= 0, cols) apart; a diagonal needs both cells beside it free."""
    number = np.arange(free.size).reshape(free.shape)
    height, width = free.shape
    here = (slice(0, height - rows), slice(max(0, -cols), width - max(0, cols)))
    there = (slice(rows, height), slice(max(0, cols), width + min(0, cols)))
    beside, above = (here[0], there[1]), (there[0], here[1])
    joined = free[here] & free[there] & free[beside] & free[above]
    return number[here][joined], number[there][joined]


def _roads(free: Mask, cell_m: float) -> Any:
    steps = [(0, 1), (1, 0), (1, 1), (1, -1)]
    pairs = [_joined(free, *step) for step in steps]
    lengths = [np.full(len(p[0]), cell_m * math.hypot(*step)) for p, step in zip(pairs, steps, strict=True)]
    start, end = (np.concatenate([p[i] for p in pairs]) for i in (0, 1))
    return csr_array((np.concatenate(lengths), (start, end)), shape=(free.size, free.size))


class DrivingDistances:
    """Shortest 8-connected drives on one occupation layer (rows, cols), 0..1 with NaN unknown, in metres."""

    def __init__(self, occupation: npt.NDArray[Any], grid: Grid) -> None:
        assert occupation.shape == grid.shape, (occupation.shape, grid.shape)
        free = ~(occupation >= BLOCKED)
        self._grid, self._roads = grid, _roads(free, grid.cell_m)
        self._free, self._free_cells = free, np.argwhere(free)
        self._cells: dict[tuple[float, float], int] = {}

    def _cell(self, x_m: float, y_m: float) -> int:
        """Flat index of the nearest free cell, the lowest index on a tie."""
        if (x_m, y_m) not in self._cells:
            self._cells[x_m, y_m] = self._nearest_free(x_m, y_m)
        return self._cells[x_m, y_m]

    def _nearest_free(self, x_m: float, y_m: float) -> int:
        if not len(self._free_cells):
            return 0
        x0, y0 = self._grid.origin_m
        at = ((y_m - y0) / self._grid.cell_m - 0.5, (x_m - x0) / self._grid.cell_m - 0.5)
        inside = max(abs(at[0] - round(at[0])), abs(at[1] - round(at[1]))) < 0.5
        if inside and (cell := self._grid.row_col(x_m, y_m)) is not None and self._free[cell]:
            return cell[0] * self._grid.cols + cell[1]  # no other centre is nearer
        apart = ((self._free_cells - at) ** 2).sum(axis=1)
        row, col = self._free_cells[int(np.argmin(apart))]
        return int(row * self._grid.cols + col)

    def between(
        self,
        from_xy_m: Sequence[tuple[float, float]],
        to_xy_m: Sequence[tuple[float, float]],
        within_m: float = math.inf,
    ) -> F64:
        """Distances (len(from), len(to)) [m]; places in obstacles move out.

        UNREACHABLE_M where no drive leads, or none of at most `within_m`.
        """
        start = np.array([self._cell(*p) for p in from_xy_m], np.int64)
        end = np.array([self._cell(*p) for p in to_xy_m], np.int64)
        if not len(start) or not len(end):
            return np.zeros((len(start), len(end)))
        places, which = np.unique(start, return_inverse=True)
        search = partial(dijkstra, self._roads, directed=False, limit=within_m)
        reach_m: F64 = np.array([search(indices=int(p))[end] for p in places])
        reach_m = np.minimum(reach_m, UNREACHABLE_M)
        return reach_m[which]

    def reachable_together(self, places_m: Sequence[tuple[float, float]]) -> I64:
        """Indices of the largest set of places that can all be reached from each other."""
        _, island = connected_components(self._roads, directed=False)
        at = island[[self._cell(*place) for place in places_m]]
        return np.flatnonzero(at == np.bincount(at).argmax())
