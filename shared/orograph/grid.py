"""Grids in the map frame: metres, x east, y north; row grows with y, column with x (mapping.md section 1)."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from orograph.arrays import F64, I64, Mask


@dataclass(frozen=True)
class Grid:
    """An origin (outer corner of cell (0, 0)), a cell side and a shape (rows, cols)."""

    origin_m: tuple[float, float]
    cell_m: float
    shape: tuple[int, int]

    def __post_init__(self) -> None:
        if not (self.cell_m > 0 and math.isfinite(self.cell_m)):
            raise ValueError(f"cell_m must be positive and finite, got {self.cell_m}")
        if min(self.shape) < 1:
            raise ValueError(f"shape must be at least (1, 1), got {self.shape}")

    @property
    def rows(self) -> int:
        """Number of rows (along y)."""
        return self.shape[0]

    @property
    def cols(self) -> int:
        """Number of columns (along x)."""
        return self.shape[1]

    @property
    def size(self) -> int:
        """Number of cells."""
        return self.shape[0] * self.shape[1]

    @property
    def extent_m(self) -> tuple[float, float, float, float]:
        """Outer edges (x_min, y_min, x_max, y_max)."""
        x0, y0 = self.origin_m
        return x0, y0, x0 + self.cols * self.cell_m, y0 + self.rows * self.cell_m

    def row_col(self, x_m: float, y_m: float) -> tuple[int, int] | None:
        """Cell that holds a point, None outside; a point on a shared edge belongs to the cell above / right."""
        row = math.floor((y_m - self.origin_m[1]) / self.cell_m)
        col = math.floor((x_m - self.origin_m[0]) / self.cell_m)
        return (row, col) if 0 <= row < self.rows and 0 <= col < self.cols else None

    def rows_cols(self, xy_m: npt.ArrayLike) -> tuple[I64, I64]:
        """Rows and columns of points (n, 2), not clipped: a point outside has an index outside."""
        xy = np.asarray(xy_m, np.float64)
        rows = np.floor((xy[..., 1] - self.origin_m[1]) / self.cell_m).astype(np.int64)
        cols = np.floor((xy[..., 0] - self.origin_m[0]) / self.cell_m).astype(np.int64)
        return rows, cols

    def contains(self, rows: I64, cols: I64) -> Mask:
        """Which (row, col) pairs lie inside."""
        return (rows >= 0) & (rows < self.rows) & (cols >= 0) & (cols < self.cols)

    def centre_m(self, row: int, col: int) -> tuple[float, float]:
        """Centre (x, y) of a cell."""
        return self.origin_m[0] + (col + 0.5) * self.cell_m, self.origin_m[1] + (row + 0.5) * self.cell_m

    def centres_m(self) -> tuple[F64, F64]:
        """Centres' x (cols,) and y (rows,)."""
        x = self.origin_m[0] + (np.arange(self.cols, dtype=np.float64) + 0.5) * np.float64(self.cell_m)
        y = self.origin_m[1] + (np.arange(self.rows, dtype=np.float64) + 0.5) * np.float64(self.cell_m)
        return x, y

    def window(self, row: int, col: int, shape: tuple[int, int]) -> Grid:
        """Same cells, another rectangle: the grid whose cell (0, 0) is this grid's (row, col)."""
        x0, y0 = self.origin_m
        return Grid((x0 + col * self.cell_m, y0 + row * self.cell_m), self.cell_m, shape)

    def refined(self, factor: int) -> Grid:
        """Same area, each cell cut into factor x factor."""
        return Grid(self.origin_m, self.cell_m / factor, (self.rows * factor, self.cols * factor))

    def coarsened(self, factor: int) -> Grid:
        """Same area, blocks of factor x factor cells made one; raises ValueError unless the shape divides."""
        if self.rows % factor or self.cols % factor:
            raise ValueError(f"shape {self.shape} is not a multiple of {factor}")
        return Grid(self.origin_m, self.cell_m * factor, (self.rows // factor, self.cols // factor))
