"""What planning sees of moving bodies in one scan: those it misses, and obstacle cells where there is nothing."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np
import numpy.typing as npt

from orograph.arrays import F64, I64, Mask
from orograph.grid import Grid
from orograph.judge.map_score import share

SEEN_POINTS = 20
"""A body with fewer points of a scan on it need not be seen in it."""
REACH_M, GHOST_M = 25.0, 20.0
DISTANCES_M = (0.0, 5.0, 10.0, 15.0, REACH_M)
NOISE_M = 0.1
"""A point this near to a body's surface is on it."""
FOOT_M = 0.15
"""Points lower than this over its foot may be ground."""
RIM_M = 0.75
"""Obstacle cells whose centre is this near to a body are its own: half a cell, and what estimated poses are off."""
SIGHTING = np.dtype([("distance_m", "<f4"), ("missed", "?")])


@dataclass(frozen=True, eq=False)
class Body:
    """A box on the ground in the map frame: middle of its foot (3,) [m], size (3,) [m], R_map_body (3, 3)."""

    foot_m: F64
    size_m: F64
    R_map_body: F64

    def points_on(self, points_m: F64) -> int:
        """How many of points (n, 3) lie on it."""
        beside = np.abs(points_m[:, :2] - self.foot_m[:2]).max(axis=1) < self.size_m[:2].sum()
        inside = (points_m[beside] - self.foot_m) @ self.R_map_body
        on = (np.abs(inside[:, :2]) <= self.size_m[:2] / 2 + NOISE_M).all(axis=1)
        return int((on & (inside[:, 2] > FOOT_M) & (inside[:, 2] < self.size_m[2] + NOISE_M)).sum())

    def covers(self, x_m: npt.ArrayLike, y_m: npt.ArrayLike, rim_m: float) -> Mask:
        """Which places (any common shape) lie in its outline or within `rim_m` beside it."""
        x, y = np.asarray(x_m) - self.foot_m[0], np.asarray(y_m) - self.foot_m[1]
        ahead, left = (np.abs(x * self.R_map_body[0, i] + y * self.R_map_body[1, i]) for i in (0, 1))
        within: Mask = (ahead <= self.size_m[0] / 2 + rim_m) & (left <= self.size_m[1] / 2 + rim_m)
        return within


def sightings(blocked: Mask, grid: Grid, robot_m: F64, points_m: F64, vehicles: Sequence[Body]) -> npt.NDArray[Any]:
    """SIGHTING (k,) of the vehicles within REACH_M of the robot (3,) that have SEEN_POINTS of points (n, 3) on them.

    A vehicle is missed unless two touching cells of `blocked` (rows, cols) over `grid` lie on it.
    """
    out = []
    for vehicle in vehicles:
        distance_m = float(np.hypot(*(vehicle.foot_m - robot_m)[:2]))
        if distance_m < REACH_M and vehicle.points_on(points_m) >= SEEN_POINTS:
            out.append((distance_m, not shows(blocked, grid, vehicle)))
    return np.array(out, SIGHTING)


def shows(blocked: Mask, grid: Grid, body: Body) -> bool:
    """Whether two touching blocked cells lie on the body."""
    rows, cols, x_m, y_m = _around(grid, body.foot_m, float(body.size_m[:2].sum()))
    cells = blocked[rows, cols] & body.covers(x_m, y_m, grid.cell_m / 2)
    pairs = (cells[1:] & cells[:-1], cells[:, 1:] & cells[:, :-1], cells[1:, 1:] & cells[:-1, :-1],
             cells[1:, :-1] & cells[:-1, 1:])  # fmt: skip
    return any(bool(pair.any()) for pair in pairs)


def remains(blocked: Mask, grid: Grid, body: Body) -> bool:
    """Whether any blocked cell is left where the body was, or within RIM_M beside that."""
    rows, cols, x_m, y_m = _around(grid, body.foot_m, float(body.size_m[:2].sum()))
    return bool((blocked[rows, cols] & body.covers(x_m, y_m, RIM_M)).any())


def ghosts(blocked: Mask, grid: Grid, robot_m: F64, clear: Mask, bodies: Sequence[Body]) -> int:
    """Cells of `blocked` within GHOST_M of the robot that are `clear` (all over `grid`) and on none of the bodies."""
    rows, cols, x_m, y_m = _around(grid, robot_m, GHOST_M)
    row, col = np.nonzero(blocked[rows, cols] & clear[rows, cols])
    x_m, y_m = x_m[0, col], y_m[row, 0]
    false = np.hypot(x_m - robot_m[0], y_m - robot_m[1]) < GHOST_M
    for body in bodies:
        false &= ~body.covers(x_m, y_m, RIM_M)
    return int(false.sum())


def obstacle_figures(seen: npt.NDArray[Any], ghost_cells: I64) -> dict[str, float]:
    """Shares missed of SIGHTINGs (k,) by distance, and the mean of ghost cells (scans,)."""
    out: dict[str, float] = {}
    for low, high in pairwise(DISTANCES_M):
        within = (seen["distance_m"] >= low) & (seen["distance_m"] < high)
        name = f"{low:.0f}_{high:.0f}_m"
        out[f"missed_{name}"] = share(int(seen["missed"][within].sum()), int(within.sum()))
        out[f"sightings_{name}"] = int(within.sum())
    out["missed"], out["sightings"] = share(int(seen["missed"].sum()), len(seen)), len(seen)
    out["ghosts_per_scan"] = float(np.mean(ghost_cells)) if len(ghost_cells) else np.nan
    return out


def _around(grid: Grid, centre_m: F64, reach_m: float) -> tuple[slice, slice, F64, F64]:
    """Rows and columns of the cells within reach of a place, and their centres' x (1, cols) and y (rows, 1)."""
    (row0, row1), (col0, col1) = grid.rows_cols([centre_m[:2] - reach_m, centre_m[:2] + reach_m])
    rows = slice(int(np.clip(row0, 0, grid.rows)), int(np.clip(row1 + 1, 0, grid.rows)))
    cols = slice(int(np.clip(col0, 0, grid.cols)), int(np.clip(col1 + 1, 0, grid.cols)))
    x_m, y_m = grid.centres_m()
    return rows, cols, x_m[None, cols], y_m[rows, None]
