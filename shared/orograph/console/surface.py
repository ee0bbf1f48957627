"""The 2.5D map as triangles, tile by tile: each cell a face, smooth over the ground, a wall where it steps."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from scipy.ndimage import binary_dilation

from orograph.arrays import F32, F64, I64, Mask
from orograph.grid import Grid

TILE_CELLS = 20
STEP_M = 1.0
"""Neighbours that differ by more meet in a wall, others in a common corner."""
CORNERS = ((0, 0), (0, 1), (1, 1), (1, 0))
"""(row, column) of a face's corners, counter-clockwise from above."""
SUN = np.array([-0.45, 0.35, 0.82])
"""Towards the light, of length 1 nearly; shading is baked into colours, so that they look the same on every machine."""
AMBIENT = 0.45


@dataclass(frozen=True, eq=False)
class Mesh:
    """vertices (v, 3) [m], faces (f, 3), and of each vertex the cell that it belongs to (v,) and its light (v,)."""

    vertices: F32
    faces: I64
    cells: I64
    light: F32


class Surface:
    """Heights (rows, cols) [m] over a grid, NaN where there is nothing to show."""

    def __init__(self, grid: Grid, height_m: F64) -> None:
        self.grid, self._height_m = grid, height_m
        self._corner_m = _corners(height_m)
        self._light = _light(self._corner_m, grid.cell_m)

    def mesh(self, rows: slice, cols: slice) -> Mesh:
        """The faces of a rectangle of cells, and the walls towards their northern and eastern neighbours."""
        r, c = (a.reshape(-1) for a in np.mgrid[rows, cols])
        known = np.isfinite(self._height_m[r, c])
        r, c = r[known], c[known]
        quads = [self._tops(r, c), *(self._walls(r, c, step) for step in ((1, 0), (0, 1)))]
        corners, cells, light = (np.concatenate(parts) for parts in zip(*quads, strict=True))
        first = 4 * np.arange(len(corners))[:, None]
        faces = (first + np.array([0, 1, 2, 0, 2, 3])).reshape(-1, 3)
        return Mesh(
            corners.reshape(-1, 3).astype(np.float32), faces, np.repeat(cells, 4), light.reshape(-1).astype(np.float32)
        )

    def _point(self, r: I64, c: I64, corner: tuple[int, int]) -> F64:
        (x0, y0), side = self.grid.origin_m, self.grid.cell_m
        return np.stack([x0 + (c + corner[1]) * side, y0 + (r + corner[0]) * side, self._corner_m[r, c, *corner]], -1)

    def _tops(self, r: I64, c: I64) -> tuple[F64, I64, F64]:
        corners = np.stack([self._point(r, c, corner) for corner in CORNERS], 1)
        return corners, r * self.grid.cols + c, np.repeat(self._light[r, c][:, None], 4, 1)

    def _walls(self, r: I64, c: I64, step: tuple[int, int]) -> tuple[F64, I64, F64]:
        """Where a cell and its neighbour of one side end at other heights; a wall has the higher one's colour."""
        inside = (r + step[0] < self.grid.rows) & (c + step[1] < self.grid.cols)
        r, c = r[inside], c[inside]
        there = np.isfinite(self._height_m[r + step[0], c + step[1]])
        r, c = r[there], c[there]
        mine, theirs = (((1, 0), (1, 1)), ((0, 0), (0, 1))) if step[0] else (((0, 1), (1, 1)), ((0, 0), (1, 0)))
        a, b = (self._point(r, c, corner) for corner in mine)
        d, e = (self._point(r + step[0], c + step[1], corner) for corner in theirs)
        apart = (np.abs(a[:, 2] - d[:, 2]) > 0.01) | (np.abs(b[:, 2] - e[:, 2]) > 0.01)
        corners = np.stack([a, b, e, d], 1)[apart]
        own, other = (r * self.grid.cols + c)[apart], ((r + step[0]) * self.grid.cols + c + step[1])[apart]
        higher = self._height_m.reshape(-1)[own] >= self._height_m.reshape(-1)[other]
        # It faces down the step: the sun's share on that side.
        facing = np.where(higher, 1.0, -1.0) * (SUN[1] if step[0] else SUN[0])
        light = AMBIENT + (1 - AMBIENT) * np.clip(0.35 + 0.65 * facing, 0, 1)
        return corners, np.where(higher, own, other), np.repeat(light[:, None], 4, 1)


def _corners(height_m: F64) -> F64:
    """Heights (rows, cols, 2, 2) of each cell's corners: the mean over those cells around that are no step away."""
    padded = np.pad(np.asarray(height_m, np.float64), 1, constant_values=np.nan)
    rows, cols = height_m.shape
    out = np.empty((rows, cols, 2, 2))
    for i, j in CORNERS:
        total, count = np.zeros((rows, cols)), np.zeros((rows, cols))
        for di in (i - 1, i):
            for dj in (j - 1, j):
                there = padded[1 + di : 1 + di + rows, 1 + dj : 1 + dj + cols]
                near = np.abs(there - height_m) <= STEP_M
                total += np.where(near, there, 0.0)
                count += near
        out[:, :, i, j] = total / np.maximum(count, 1)
    return out


def _light(corner_m: F64, cell_m: float) -> F64:
    """Light (rows, cols) on each cell's face by its mean slope, which is exaggerated to be seen."""
    slope_x = (corner_m[:, :, :, 1] - corner_m[:, :, :, 0]).mean(axis=2) / cell_m * 2.5
    slope_y = (corner_m[:, :, 1, :] - corner_m[:, :, 0, :]).mean(axis=2) / cell_m * 2.5
    towards = (SUN[2] - slope_x * SUN[0] - slope_y * SUN[1]) / np.sqrt(1 + slope_x**2 + slope_y**2)
    return np.asarray(AMBIENT + (1 - AMBIENT) * np.clip(towards / SUN[2], 0, 1.25))


def tiles(grid: Grid) -> dict[tuple[int, int], tuple[slice, slice]]:
    """Rows and columns of each tile by its place."""
    return {
        (i, j): (slice(i * TILE_CELLS, min((i + 1) * TILE_CELLS, grid.rows)),
                 slice(j * TILE_CELLS, min((j + 1) * TILE_CELLS, grid.cols)))
        for i in range(-(-grid.rows // TILE_CELLS)) for j in range(-(-grid.cols // TILE_CELLS))
    }  # fmt: skip


def touched(changed: Mask) -> Iterator[tuple[int, int]]:
    """Places of the tiles that show cells (rows, cols) which changed, or a corner or wall beside one."""
    around = binary_dilation(changed, np.ones((3, 3), np.bool_))
    rows, cols = np.nonzero(around)
    yield from sorted(set(zip((rows // TILE_CELLS).tolist(), (cols // TILE_CELLS).tolist(), strict=True)))
