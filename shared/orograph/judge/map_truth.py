"""What is truly there, cell by cell: the ground, the highest top, how much of the cell is built up."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TypeVar

import numpy as np
import numpy.typing as npt
from scipy.ndimage import binary_dilation

from orograph.arrays import F64, Mask
from orograph.grid import Grid
from orograph.scene import Scene
from orograph.scene.prior import COVERED
from orograph.scene.terrain import ground_gradient
from orograph.sensing.truth import top_surface

T = TypeVar("T", bound=np.generic)
STANDS_M = 0.5
"""A place is built up where the true surface is this much above the ground."""
PLACES_GLRM, PLACES_HRM = 8, 3
"""Vertical rays per cell side: one every 0.6 m and every 0.17 m by default."""
NEAR_GLRM, NEAR_HRM = 1, 2
"""Open cells within 5 m and within 1 m of a wall's cell are near it."""
PLACES_AT_A_TIME = 2_000_000
"""So many rays are cast at a time, which bounds the memory."""


@dataclass(frozen=True, eq=False)
class MapTruth:
    """Layers (rows, cols) over one grid, heights in metres."""

    grid: Grid
    ground_m: F64
    """Mean ground where the cell is not built up; at its centre where all of it is."""
    top_m: F64
    """Highest surface in the cell; NaN where nothing stands."""
    surface_m: F64
    """Mean of the upper surface, as high as anything that stands there."""
    roof: Mask
    """Cells that count as built up, by the share that the prior goes by."""
    steep: Mask
    """Steeper at the centre than the robot can climb."""
    near: Mask
    """Open cells within a number of cells of something built up."""

    @property
    def barred(self) -> Mask:
        """Cells that cannot be driven."""
        return self.roof | self.steep

    @property
    def clear(self) -> Mask:
        """Cells where no obstacle can be: open, not near walls, not steep."""
        return ~(self.near | self.barred)

    def over(self, grid: Grid) -> MapTruth:
        """The same over another aligned grid of the same cell; outside nothing stands and the ground is NaN."""

        def cut(layer: Mask) -> Mask:
            return window(layer, self.grid, grid, False)

        heights_m = (self.ground_m, self.top_m, self.surface_m)
        ground_m, top_m, surface_m = (window(layer, self.grid, grid, np.nan) for layer in heights_m)
        return MapTruth(grid, ground_m, top_m, surface_m, cut(self.roof), cut(self.steep), cut(self.near))


def window(layer: npt.NDArray[T], grid: Grid, wanted: Grid, outside: float | bool) -> npt.NDArray[T]:
    """A layer over `grid` as one over an aligned grid of the same cell that may hang over the edge."""
    out = np.full(wanted.shape, outside, layer.dtype)
    row = round((wanted.origin_m[1] - grid.origin_m[1]) / grid.cell_m)
    col = round((wanted.origin_m[0] - grid.origin_m[0]) / grid.cell_m)
    rows, cols = slice(max(row, 0), max(row + wanted.rows, 0)), slice(max(col, 0), max(col + wanted.cols, 0))
    part = layer[rows, cols]
    r, c = rows.start - row, cols.start - col
    out[r : r + part.shape[0], c : c + part.shape[1]] = part
    return out


def true_map(scene: Scene, grid: Grid, places: int, near_cells: int) -> MapTruth:
    """The truth from `places` x `places` vertical rays a cell; open cells within `near_cells` of a wall are near."""
    rows = max(1, PLACES_AT_A_TIME // (grid.cols * places**2))
    strips = [_strip(scene, grid.window(r, 0, (min(rows, grid.rows - r), grid.cols)), places)
              for r in range(0, grid.rows, rows)]  # fmt: skip
    ground_m, top_m, surface_m, cover = (np.concatenate(layers) for layers in zip(*strips, strict=True))
    slope = np.hypot(*ground_gradient(scene.scenario.terrain, *np.meshgrid(*grid.centres_m())))
    steep, roof = slope > scene.scenario.robot.slope_max, cover >= COVERED
    near: Mask = binary_dilation(cover > 0, np.ones((3, 3), np.bool_), iterations=near_cells)
    return MapTruth(grid, ground_m, top_m, surface_m, roof, steep, near & ~roof)


def _strip(scene: Scene, grid: Grid, places: int) -> tuple[F64, F64, F64, F64]:
    fine = grid.refined(places)
    surface_m, _ = top_surface(scene, fine, 1)
    ground_m = scene.height_m(*np.meshgrid(*fine.centres_m()))
    stands = surface_m - ground_m > STANDS_M
    blocks = (grid.rows, places, grid.cols, places)

    def share(of: npt.NDArray[np.generic]) -> F64:
        return np.asarray(of.reshape(blocks).mean(axis=(1, 3)), np.float64)

    free, centre_m = share(~stands), scene.height_m(*np.meshgrid(*grid.centres_m()))
    with np.errstate(invalid="ignore"):
        mean_m = np.where(free > 0, share(np.where(stands, 0.0, ground_m)) / free, centre_m)
    top_m = np.where(stands, surface_m, -np.inf).reshape(blocks).max(axis=(1, 3))
    return mean_m, np.where(np.isfinite(top_m), top_m, np.nan), share(surface_m), 1.0 - free
