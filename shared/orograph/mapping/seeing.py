"""Seeing through: the rays of one scan against what stands in the map (mapping.md 7.4)."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from orograph.arrays import F32, F64, I64, U1
from orograph.grid import Grid
from orograph.mapping.cells import Cells, Values
from orograph.mapping.seeing_kernels import (  # fmt: skip
    BEYOND,
    BINS,
    aim_rays,
    count_passes,
    find_raised,
    free_unseen,
    sort_rays,
)


class Rays:
    """One scan's rays sorted by direction, with their memory kept from scan to scan."""

    def __init__(self) -> None:
        self._first: npt.NDArray[np.uint64] = np.zeros(BINS + 2, np.uint64)
        self._low_m: F64 = np.zeros(BINS)
        self._far_m: F64 = np.zeros(BINS)
        self.clear_m: F64 = np.full(BINS, math.inf)
        """How far nothing stands, by direction."""
        self._sized(0)

    def _sized(self, points: int) -> None:
        self._bins: npt.NDArray[np.uint32] = np.empty(points, np.uint32)
        self._aimed: F64 = np.empty((3, points))
        self._order: npt.NDArray[np.uint32] = np.empty(points, np.uint32)
        self._reach_m: F64 = np.empty(points)
        self._rise: F64 = np.empty(points)
        self._raised: U1 = np.zeros(points, np.uint8)

    def sort(self, xyz: F64, eye_m: F64, cell_m: float, rise_max: float = math.inf) -> None:
        """Take a scan's points (3, n) seen from `eye_m` (3,), those of rays that rise by no more than `rise_max`."""
        n = xyz.shape[1]
        if n > len(self._order):
            self._sized(n)
        bins, (flat_m, up, clear_m) = self._bins[:n], self._aimed[:, :n]
        aim_rays(xyz, eye_m, BEYOND * cell_m, rise_max, bins, flat_m, up, clear_m)
        rays = self._order, self._reach_m, self._rise
        sort_rays(bins, flat_m, up, clear_m, self._first, *rays, self._low_m, self._far_m)

    def raised(self, points: int, steepest: float) -> U1:
        """Whether each of the sorted points (n,) is ground, raised or unclear (`seeing_kernels`).

        Ground is what a slope of `steepest` [m/m] leads to.
        """
        rays = self._first, self._order, self._reach_m, self._rise
        find_raised(steepest, *rays, self._raised[:points], self.clear_m)
        return self._raised[:points]

    def passes(self, eye_m: F64, grid: Grid, cells: Cells, tops_m: F32, clear_m: F64) -> I64:
        """How many rays cross each of `cells` (k,) of `grid` below its top (k,), not beyond `clear_m` (BINS,)."""
        passes: I64 = np.zeros(len(cells), np.int64)
        place = (grid.cols, *grid.origin_m, grid.cell_m)
        rays = self._first, self._reach_m, self._rise, self._far_m
        count_passes(cells, tops_m, *place, eye_m, *rays, clear_m, passes)
        return passes

    def free_unseen(self, values: Values, hit: Cells, factor: int, grid: Grid, eye_m: F64) -> None:
        """In the blocks of cells `hit` (k,), free those of which nothing is known and over which rays go on."""
        place = (grid.cols // factor, factor, *grid.origin_m, grid.cell_m)
        free_unseen(values, hit, *place, eye_m, self._low_m)
