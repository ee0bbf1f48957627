"""Seeing through: the rays of one scan against what stands in the map (mapping.md 7.4)."""

from __future__ import annotations

import numpy as np

from orograph.arrays import F32, F64, I64, Mask
from orograph.grid import Grid
from orograph.mapping.cells import Cells, Values
from orograph.mapping.seeing_kernels import BINS, count_passes, find_raised, free_unseen, sort_rays


class Rays:
    """One scan's rays sorted by direction, with their memory kept from scan to scan."""

    def __init__(self) -> None:
        self._first: I64 = np.zeros(BINS + 1, np.int64)
        self._low_m: F64 = np.zeros(BINS)
        self._far_m: F64 = np.zeros(BINS)
        self._sized(0)

    def _sized(self, points: int) -> None:
        self._order: I64 = np.empty(points, np.int64)
        self._reach_m: F64 = np.empty(points)
        self._rise: F64 = np.empty(points)
        self._raised: Mask = np.zeros(points, np.bool_)

    def sort(self, xyz: F64, eye_m: F64, steepest: float) -> Mask:
        """Take a scan's points (3, n) seen from `eye_m` (3,); which of them (n,) cannot be ground.

        Ground is what a slope of `steepest` [m/m] leads to.
        """
        n = xyz.shape[1]
        if n > len(self._order):
            self._sized(n)
        rays = self._order, self._reach_m, self._rise
        sort_rays(xyz, eye_m, self._first, *rays, self._low_m, self._far_m)
        find_raised(steepest, self._first, *rays, self._raised[:n])
        return self._raised[:n]

    def passes(self, eye_m: F64, grid: Grid, cells: Cells, tops_m: F32) -> I64:
        """How many rays cross each of `cells` (k,) of `grid` below its top (k,)."""
        passes: I64 = np.zeros(len(cells), np.int64)
        place = (grid.cols, *grid.origin_m, grid.cell_m)
        count_passes(cells, tops_m, *place, eye_m, self._first, self._reach_m, self._rise, self._far_m, passes)
        return passes

    def free_unseen(self, values: Values, blocks: Cells, factor: int, grid: Grid, eye_m: F64) -> None:
        """Free those fine cells of `blocks` (k,) of which nothing is known and over which rays go on, in place."""
        place = (grid.cols // factor, factor, *grid.origin_m, grid.cell_m)
        free_unseen(values, blocks, *place, eye_m, self._low_m)
