"""The reference route: the shortest way along the patrol over the prior's free cells, as poses to scan from."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from scipy.sparse import coo_array
from scipy.sparse.csgraph import dijkstra

from orograph.grid import Grid
from orograph.registers import unpack
from orograph.scenario import Scenario
from orograph.scene.prior import prior_records

F64 = npt.NDArray[np.float64]
Mask = npt.NDArray[np.bool_]
BLOCKED = 1.0
NEIGHBOURS = ((0, 1), (1, 0), (1, 1), (1, -1))


def patrol_poses(scenario: Scenario, spacing_m: float) -> F64:
    """Poses (n, 3) x [m], y [m], yaw [rad] along the patrol, `spacing_m` apart and no stretch twice."""
    stops = np.array([(scenario.starts[0].x_m, scenario.starts[0].y_m), *scenario.patrol])
    return without_repeats(
        resampled(shortest_way(free_cells(scenario), scenario.grid.grid, stops), spacing_m), spacing_m
    )


def free_cells(scenario: Scenario) -> Mask:
    """GLRM cells (rows, cols) that the prior does not block."""
    prior = unpack(prior_records(scenario), scenario.grid.grid)
    return ~(prior.occupation >= BLOCKED)


def shortest_way(free: Mask, grid: Grid, stops_m: F64) -> F64:
    """Points (n, 2) [m] of the shortest 8-connected way through the stops in order, corners not cut.

    A stop on a blocked cell is reached at its nearest free one; one that cannot be reached is left out.
    """
    nodes = [_nearest_free(free, grid, stop) for stop in stops_m]
    graph = _graph(free, grid.cell_m)
    way = [nodes[0]]
    for goal in nodes[1:]:
        distance, before = dijkstra(graph, indices=goal, return_predecessors=True)
        if not np.isfinite(distance[way[-1]]):
            continue
        while way[-1] != goal:
            way.append(int(before[way[-1]]))
    rows, cols = np.divmod(np.array(way), grid.cols)
    x, y = grid.centres_m()
    return np.stack([x[cols], y[rows]], axis=1)


def _nearest_free(free: Mask, grid: Grid, stop_m: F64) -> int:
    rows, cols = np.nonzero(free)
    x, y = grid.centres_m()
    best = int(np.argmin((x[cols] - stop_m[0]) ** 2 + (y[rows] - stop_m[1]) ** 2))
    return int(rows[best] * grid.cols + cols[best])


def _graph(free: Mask, cell_m: float) -> coo_array:
    rows, cols = np.nonzero(free)
    start, end, cost = [], [], []
    for dr, dc in NEIGHBOURS:
        r, c = rows + dr, cols + dc
        inside = (r < free.shape[0]) & (c >= 0) & (c < free.shape[1])
        r0, c0, r, c = rows[inside], cols[inside], r[inside], c[inside]
        go = free[r, c] & free[r0, c] & free[r, c0]
        start.append(r0[go] * free.shape[1] + c0[go])
        end.append(r[go] * free.shape[1] + c[go])
        cost.append(np.full(int(go.sum()), cell_m * np.hypot(dr, dc)))
    a, b, w = np.concatenate(start), np.concatenate(end), np.concatenate(cost)
    edges = np.concatenate([a, b]), np.concatenate([b, a])
    return coo_array((np.concatenate([w, w]), edges), shape=(free.size, free.size)).tocsr()


def resampled(way_m: F64, spacing_m: float) -> F64:
    """Poses (n, 3) every `spacing_m` along a polyline (m, 2), facing along it; the first point is always among them."""
    steps = np.diff(way_m, axis=0)
    lengths = np.hypot(steps[:, 0], steps[:, 1])
    steps, starts = steps[lengths > 0], way_m[:-1][lengths > 0]
    lengths = lengths[lengths > 0]
    if not lengths.size:
        return np.array([[*way_m[0], 0.0]])
    ends = np.cumsum(lengths)
    at = np.arange(0.0, ends[-1], spacing_m)
    leg = np.minimum(np.searchsorted(ends, at, side="right"), len(ends) - 1)
    share = (at - (ends - lengths)[leg]) / lengths[leg]
    yaw = np.arctan2(steps[:, 1], steps[:, 0])[leg]
    return np.column_stack([starts[leg] + steps[leg] * share[:, None], yaw])


def without_repeats(poses: F64, spacing_m: float) -> F64:
    """Those poses (n, 3), in order, that stand in no square of `spacing_m` where an earlier one stands."""
    squares = np.floor(poses[:, :2] / spacing_m).astype(np.int64)
    _, first = np.unique(squares, axis=0, return_index=True)
    return poses[np.sort(first)]
