"""Least difficult paths over occupation: a global route on the GLRM's cells, a local path on the HRM's.

Cost per metre grows with occupation, unknown costs more than free, occupation >= 0.95 is blocked. Near obstacles the
cost rises, so that paths keep to the middle of streets.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from orograph.arrays import F64, I64, U1, Mask
from orograph.grid import Grid
from orograph.layers import OCCUPATION_ONE, UNKNOWN_OCCUPATION
from orograph.messages import OccupancyGrid
from orograph.navigation.planner_kernels import blocked_cells, least_cost_path, nearest_finite, obstacle_distance

PointXY = tuple[float, float]

BLOCKED = math.ceil(0.95 * OCCUPATION_ONE)
OCCUPIED_COST = 8.0
UNKNOWN_COST = 3.0
GLOBAL_NEAR_COST = 2.0
GLOBAL_SHUT_COST = 80.0
"""Per cell where the map shows an obstacle, or where the robot has failed before: only if nothing else leads there."""
LOCAL_HALF_M = 32.0
"""Half side of the part of the HRM that a local path is sought in."""
LETHAL_M = 0.75
"""Half the robot's diagonal (0.47 m) and half a cell's: a centre nearer than this to a blocked centre is blocked."""
NEAR_M, NEAR_COST = 3.0, 6.0
SUSPECT_COST = 40.0
"""Blocked in the HRM, not in the GLRM: a vehicle that may have driven on. Passed only if there is no other way."""
LEAVE_M, LEAVE_COST = 0.8, 15.0
"""A robot that stands inside the margin may leave it: nothing this near to its centre blocks."""
SMOOTHING = 16
"""Passes of a (1, 2, 1) / 4 mean over path points half a metre apart: a right angle becomes a curve of 2 m."""
GOAL_REACH_M = 12.0
"""A goal inside an obstacle moves to the nearest free cell within this."""
MOVED_M = 3.0
"""A goal that was moved further than this is not passed on the way to the next: it may not count as visited."""


@dataclass(frozen=True, eq=False)
class LocalPath:
    """Path points (n, 2) [m] about a cell apart and the obstacle distance (n,) [m] at each."""

    xy_m: F64
    clearance_m: F64
    legs: tuple[int, ...]
    """Index of the point at which each target is reached."""
    suspect: bool
    """It leads through cells that look blocked now."""


def planning_grid(planning_map: OccupancyGrid) -> Grid:
    """The grid of a planning map."""
    rows, cols = planning_map.occupation.shape
    return Grid((planning_map.x0_m, planning_map.y0_m), planning_map.cell_m, (rows, cols))


def occupation_cost(occupation: U1) -> F64:
    """Cost per metre (rows, cols), >= 1, of occupation in 1/254; obstacles are not treated here."""
    share = occupation * (1.0 / OCCUPATION_ONE)
    return np.where(occupation == UNKNOWN_OCCUPATION, UNKNOWN_COST, 1.0 + OCCUPIED_COST * share * share)


def global_cost(planning_map: OccupancyGrid, shut: Iterable[tuple[int, int]] = ()) -> F64:
    """Cost (rows, cols) of the GLRM's cells, inf where blocked; `shut` cells cost as much as obstacles in need."""
    occupation = planning_map.occupation
    blocked = blocked_cells(occupation, BLOCKED, UNKNOWN_OCCUPATION, True)
    near = obstacle_distance(blocked, 1) < 1.5
    cost = np.where(blocked, np.inf, occupation_cost(occupation) + GLOBAL_NEAR_COST * near)
    for row, col in shut:
        cost[row, col] = max(cost[row, col], GLOBAL_SHUT_COST)
    return cost


def global_route(
    planning_map: OccupancyGrid, start: PointXY, goal: PointXY, shut: Iterable[tuple[int, int]] = ()
) -> F64 | None:
    """Cell centres (n, 2) from start to goal, the goal itself last; None if one of them is off the map.

    Where free cells do not connect them, blocked cells are passed at GLOBAL_SHUT_COST: 5 m cells may close a passage
    that the HRM knows to be open, and the local path decides.
    """
    grid = planning_grid(planning_map)
    start_cell, goal_cell = grid.row_col(*start), grid.row_col(*goal)
    if start_cell is None or goal_cell is None:
        return None
    cost = global_cost(planning_map, shut)
    relaxed = np.where(np.isinf(cost), GLOBAL_SHUT_COST, cost)
    cost[start_cell] = relaxed[start_cell]
    end = nearest_finite(cost, *goal_cell, reach=math.ceil(GOAL_REACH_M / grid.cell_m))
    cells = np.empty(0, np.int64)
    begin = start_cell[0] * grid.cols + start_cell[1]
    if end >= 0:
        cells, _ = least_cost_path(cost, begin, end)
    if len(cells) == 0:
        cells, _ = least_cost_path(relaxed, begin, goal_cell[0] * grid.cols + goal_cell[1])
    route = _centres(cells, grid)
    return np.vstack([route[:-1], goal]) if end in (-1, goal_cell[0] * grid.cols + goal_cell[1]) else route


def _centres(cells: I64, grid: Grid) -> F64:
    rows, cols = np.divmod(cells, grid.cols)
    return np.column_stack(
        [grid.origin_m[0] + (cols + 0.5) * grid.cell_m, grid.origin_m[1] + (rows + 0.5) * grid.cell_m]
    )


def local_window(planning_map: OccupancyGrid, centre: PointXY) -> OccupancyGrid | None:
    """The part of a planning map within LOCAL_HALF_M of a place; None if the place is off the map."""
    grid = planning_grid(planning_map)
    cell = grid.row_col(*centre)
    if cell is None:
        return None
    half = int(LOCAL_HALF_M / grid.cell_m)
    row0, col0 = max(0, cell[0] - half), max(0, cell[1] - half)
    part = planning_map.occupation[row0 : cell[0] + half, col0 : cell[1] + half]
    x0, y0 = grid.window(row0, col0, (1, 1)).origin_m
    occupation = np.ascontiguousarray(part)
    return OccupancyGrid(planning_map.stamp_ns, x0, y0, grid.cell_m, planning_map.is_global, occupation)


def local_target(route: F64, position: PointXY, window: Grid) -> tuple[PointXY, bool]:
    """Where the route leaves the window (2 m inside) on from the robot; True if that is its end."""
    x0, y0, x1, y1 = window.extent_m
    nearest = int(np.argmin(np.hypot(*(route - position).T)))
    ahead = route[nearest:]
    x, y = ahead.T
    inside = (x > x0 + 2) & (x < x1 - 2) & (y > y0 + 2) & (y < y1 - 2)
    last = len(ahead) - 1 if inside.all() else max(0, int(np.argmin(inside)) - 1)
    return (float(x[last]), float(y[last])), last == len(ahead) - 1


def local_path(
    window: OccupancyGrid, position: PointXY, targets: Sequence[PointXY], global_map: OccupancyGrid
) -> LocalPath | None:
    """Least difficult path within a local window by way of targets; None if there is none to the first.

    It goes through suspect cells only if there is no other way to the first target. It ends where a target had to be
    moved out of an obstacle by more than MOVED_M, or cannot be reached from the one before.
    """
    grid = planning_grid(window)
    stops = [grid.row_col(*point) for point in (position, *targets)]
    cells = [cell for cell in stops if cell is not None]
    if len(cells) < len(stops):
        return None
    cost, clearance_m = local_cost(window)
    blocked, around = np.isinf(cost), _within(grid, position, LEAVE_M)
    cost[around & blocked] = LEAVE_COST
    found = _search(cost, cells, grid)
    suspect = not found
    if suspect:
        walls = blocked_in(global_map, grid) & (clearance_m == 0)
        cost[blocked & ~walls & ~around] = SUSPECT_COST
        found = _search(cost, cells, grid)
    if not found:
        return None
    path = np.concatenate([found[0], *(part[1:] for part in found[1:])])
    clearance = clearance_m.reshape(-1)[path]
    legs = tuple(int(n) for n in np.cumsum([len(part) - 1 for part in found]))
    return LocalPath(_smoothed(_centres(path, grid), clearance), clearance, legs, suspect)


def local_cost(window: OccupancyGrid) -> tuple[F64, F64]:
    """(cost, obstacle distance [m]) of a local window, both (rows, cols); a blocked cell all alone is noise."""
    blocked = blocked_cells(window.occupation, BLOCKED, UNKNOWN_OCCUPATION, False)
    clearance_m = obstacle_distance(blocked, math.ceil(NEAR_M / window.cell_m)) * window.cell_m
    near = np.clip((NEAR_M - clearance_m) / (NEAR_M - LETHAL_M), 0.0, 1.0)
    cost = occupation_cost(window.occupation) + NEAR_COST * near * near
    cost[clearance_m < LETHAL_M] = np.inf
    return cost, clearance_m


def blocked_in(planning_map: OccupancyGrid, grid: Grid) -> Mask:
    """Which cells of another grid (rows, cols) lie in blocked cells of a planning map; outside of it none does."""
    x, y = grid.centres_m()
    coarse = planning_grid(planning_map)
    rows, _ = coarse.rows_cols(np.column_stack([np.full_like(y, coarse.origin_m[0]), y]))
    _, cols = coarse.rows_cols(np.column_stack([x, np.full_like(x, coarse.origin_m[1])]))
    r, c = np.meshgrid(rows, cols, indexing="ij")
    inside = coarse.contains(r, c)
    values = planning_map.occupation[np.clip(r, 0, coarse.rows - 1), np.clip(c, 0, coarse.cols - 1)]
    blocked: Mask = inside & (values >= BLOCKED) & (values != UNKNOWN_OCCUPATION)
    return blocked


def _within(grid: Grid, centre: PointXY, radius_m: float) -> Mask:
    x, y = grid.centres_m()
    near: Mask = (x[None, :] - centre[0]) ** 2 + (y[:, None] - centre[1]) ** 2 <= radius_m**2
    return near


def _search(cost: F64, stops: Sequence[tuple[int, int]], grid: Grid) -> list[I64]:
    """Cells of the path from each stop to the next, as far as they can be reached."""
    parts: list[I64] = []
    start = stops[0][0] * grid.cols + stops[0][1]
    for row, col in stops[1:]:
        goal = nearest_finite(cost, row, col, math.ceil(GOAL_REACH_M / grid.cell_m))
        cells = least_cost_path(cost, start, goal)[0] if goal >= 0 else np.empty(0, np.int64)
        if len(cells) == 0:
            break
        parts.append(cells)
        start = goal
        if math.hypot(goal // grid.cols - row, goal % grid.cols - col) * grid.cell_m > MOVED_M:
            break
    return parts


def _smoothed(xy_m: F64, clearance_m: F64) -> F64:
    """The path's corners rounded, by a metre where there is room for it."""
    smooth = xy_m.copy()
    for _ in range(SMOOTHING):
        smooth[1:-1] = 0.25 * smooth[:-2] + 0.5 * smooth[1:-1] + 0.25 * smooth[2:]
    room = np.clip((clearance_m - LETHAL_M) / (NEAR_M - LETHAL_M), 0.0, 1.0)
    return xy_m + room[:, None] * (smooth - xy_m)
