"""One scan to the 3DLaserAuxMap (mapping.md section 2, Eq. 1-10)."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from orograph.arrays import F64, I64, U1
from orograph.grid import Grid
from orograph.layers import CellMap
from orograph.mapping import reconstruction_kernels as kernels
from orograph.mapping.cells import Cells, Values, map_of, unknown_values
from orograph.mapping.door import beyond, checked_points, checked_ranges, positive
from orograph.mapping.surface_kernels import blank_groundless, surfaces
from orograph.rules import PAPER, SLOPE_MAX, RealRules
from orograph.stages import Stage, untimed

DROP_REASONS = ("not_finite", "beyond_range", "outside_grid")


class _Workspace(NamedTuple):
    slot_of_cell: npt.NDArray[np.uint32]
    cell_of_point: npt.NDArray[np.uint32]
    slot_of_point: npt.NDArray[np.uint32]
    sub_cell: U1
    east: F64
    north: F64
    cell_of_slot: I64
    count_of_slot: npt.NDArray[np.uint32]
    height: F64
    moments: F64
    hits: I64
    weight: F64
    values: Values
    lowest: F64
    highest: F64
    foot: F64
    kind: U1
    top: F64

    @classmethod
    def sized(cls, cells: int, points: int) -> _Workspace:
        slots = min(cells, points)
        return cls(
            np.full(cells, kernels.NONE, np.uint32), np.empty(points, np.uint32), np.empty(points, np.uint32),
            np.empty(points, np.uint8), np.empty(points), np.empty(points), np.empty(slots, np.int64),
            np.empty(slots, np.uint32), np.empty(slots), np.empty((slots, 8)), np.empty(slots, np.int64),
            np.empty(slots), unknown_values(slots), np.empty(slots), np.empty(slots), np.empty(slots),
            np.empty(slots, np.uint8), np.empty((slots, 4)),
        )  # fmt: skip


class Reconstructor:
    """Section 2 on grids of one shape, with its memory kept from scan to scan."""

    def __init__(self, cells: int, range_max_m: float, rules: RealRules, stage: Stage = untimed) -> None:
        """`cells`: number of cells of the grids to come."""
        self._cells, self._range_max_m, self._rules, self._stage = cells, range_max_m, rules, stage
        self._workspace = _Workspace.sized(cells, 0)
        self.dropped: I64 = np.zeros(len(DROP_REASONS), np.int64)
        """Points dropped so far, in the order of DROP_REASONS."""

    def aux(
        self, points: npt.NDArray[Any], ranges_m: npt.NDArray[Any], grid: Grid, held: Values, raised: U1
    ) -> tuple[Cells, Values, U1]:
        """Cells (k,) of `grid` that points (n, 3) fell into, their values (k, WIDTH) and kinds, until the next call.

        Two surfaces are told apart by the ground of what is `held` (grid.size, WIDTH) and by which points (n,) are
        `raised`.
        """
        assert points.shape == (len(ranges_m), 3) and grid.size == self._cells, (points.shape, grid)
        xyz, ranges_m = np.ascontiguousarray(points.T, np.float64), np.ascontiguousarray(ranges_m)
        if len(points) > len(self._workspace.slot_of_point):
            self._workspace = _Workspace.sized(self._cells, len(points))
        w, r, rules, (x0, y0), side = self._workspace, self._range_max_m, self._rules, grid.origin_m, grid.cell_m
        with self._stage("height"):
            place = (x0, y0, side, grid.rows, grid.cols)
            if rules.two_surfaces:
                n = surfaces(xyz, ranges_m, r, *place, held, raised, rules, w, self.dropped)
            else:
                n = kernels.heights(xyz, ranges_m, r, *place, w, self.dropped)
        with self._stage("gradients"):
            kernels.gradients(xyz[2], n, side, grid.rows, grid.cols, w)
        with self._stage("confidence"):
            kernels.confidences(ranges_m, n, r, w)
        with self._stage("occupation"):
            kernels.occupations(n, rules.slope_max, w.values)
        if rules.two_surfaces:
            blank_groundless(n, w)
        kernels.release(n, w.cell_of_slot, w.slot_of_cell)
        return w.cell_of_slot[:n], w.values[:n], w.kind[:n]


def reconstruct(
    points: npt.ArrayLike, ranges_m: npt.ArrayLike, grid: Grid, range_max_m: float, slope_max: float = SLOPE_MAX
) -> CellMap:
    """The 3DLaserAuxMap of points (n, 3) [m, map frame] measured at ranges (n,) [m] (mapping.md section 2).

    Points that are not finite, at no positive range, beyond `range_max_m` or outside the grid are dropped.
    Raises ValueError for what is no scan.
    """
    points = checked_points(points)
    points, ranges_m, _ = beyond(points, checked_ranges(ranges_m, len(points)), 0.0)
    maker = Reconstructor(grid.size, positive("range_max_m", range_max_m), PAPER.real(slope_max))
    raised = np.zeros(len(points), np.uint8)
    values = unknown_values(grid.size)
    cells, touched, _ = maker.aux(points, ranges_m, grid, values, raised)
    values[cells] = touched
    return map_of(values, grid)
