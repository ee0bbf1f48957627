"""The reference route: every robot's share of the patrol by the shortest way over the prior's free cells, as poses."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from scipy.sparse import coo_array
from scipy.sparse.csgraph import dijkstra

from orograph.grid import Grid
from orograph.mission.distances import BLOCKED, DrivingDistances
from orograph.mission.split import split_patrol
from orograph.mission.tour import VISIT_M
from orograph.registers import unpack
from orograph.scenario import Scenario
from orograph.scene.prior import prior_records

F64 = npt.NDArray[np.float64]
Mask = npt.NDArray[np.bool_]
NEIGHBOURS = ((0, 1), (1, 0), (1, 1), (1, -1))


def patrol_poses(scenario: Scenario, spacing_m: float) -> F64:
    """Poses (n, 3) x [m], y [m], yaw [rad] along every robot's share of the patrol, `spacing_m` apart, none twice."""
    prior, grid = unpack(prior_records(scenario), scenario.grid.grid), scenario.grid.grid
    free = ~(prior.occupation >= BLOCKED)
    ways = [shortest_way(free, grid, stops) for stops in shares(scenario, DrivingDistances(prior.occupation, grid))]
    return without_repeats(np.concatenate([short_of_the_end(resampled(way, spacing_m)) for way in ways]), spacing_m)


def shares(scenario: Scenario, roads: DrivingDistances) -> list[F64]:
    """Stops (m, 2) [m] of each robot: its start and its waypoints in order, as the patrol is split at the start."""
    starts = [(start.x_m, start.y_m) for start in scenario.starts[: scenario.robots]]
    places = [*starts, *scenario.patrol]
    orders = split_patrol(len(starts), roads.between(places, places))
    return [
        np.array([start, *(scenario.patrol[i] for i in order)]) for start, order in zip(starts, orders, strict=True)
    ]


def short_of_the_end(poses: F64) -> F64:
    """Poses (n, 3) without the last stretch, which a robot that has visited its last waypoint need not drive."""
    away = np.hypot(*(poses[:, :2] - poses[-1, :2]).T)
    ending = np.flatnonzero(away > VISIT_M)
    return poses[: ending[-1] + 1] if ending.size else poses[:1]


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
