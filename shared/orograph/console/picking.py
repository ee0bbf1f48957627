"""Which cell a click on the page means."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from orograph.arrays import F64
from orograph.grid import Grid

STEPS_PER_CELL = 8


def cell_hit(
    grid: Grid, height_m: npt.NDArray[np.floating], eye_m: F64, direction: F64
) -> tuple[int, int] | None:  # fmt: skip
    """The first cell (row, col) whose surface [m] a ray from above runs into, None where it meets none."""
    x0, y0, x1, y1 = grid.extent_m
    reach_m = float(np.hypot(x1 - x0, y1 - y0)) + float(np.linalg.norm(eye_m - (x0, y0, 0.0)))
    along_m = np.arange(0.0, reach_m, grid.cell_m / STEPS_PER_CELL)[:, None]
    points = eye_m + along_m * direction / np.linalg.norm(direction)
    rows, cols = grid.rows_cols(points[:, :2])
    inside = np.flatnonzero(grid.contains(rows, cols))
    below = points[inside, 2] <= height_m[rows[inside], cols[inside]]
    if not below.any():
        return None
    first = inside[np.argmax(below)]
    return int(rows[first]), int(cols[first])
