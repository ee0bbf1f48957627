"""The reference route: every robot's share of the patrol as the navigator would plan it over the prior, as poses."""

from __future__ import annotations

import numpy as np

from orograph.arrays import F64
from orograph.messages import OccupancyGrid
from orograph.mission.distances import DrivingDistances
from orograph.mission.split import split_patrol
from orograph.navigation.planner import global_route
from orograph.navigation.tour import VISIT_M
from orograph.registers import unpack
from orograph.scenario import Scenario
from orograph.scene.prior import prior_records


def patrol_poses(scenario: Scenario, spacing_m: float) -> F64:
    """Poses (n, 3) x [m], y [m], yaw [rad] along every robot's share of the patrol, `spacing_m` apart, none twice."""
    records, grid = prior_records(scenario), scenario.grid.grid
    told = OccupancyGrid(0, *grid.origin_m, grid.cell_m, True, records["occupation"].reshape(grid.shape))
    roads = DrivingDistances(unpack(records, grid).occupation, grid)
    ways = [planned_way(told, stops) for stops in shares(scenario, roads)]
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


def planned_way(prior: OccupancyGrid, stops_m: F64) -> F64:
    """Points (n, 2) [m] of the least difficult way through the stops (m, 2) in order, as the navigator plans it.

    A stop that cannot be reached is left out.
    """
    legs, here = [stops_m[:1]], stops_m[0]
    for goal in stops_m[1:]:
        leg = global_route(prior, (here[0], here[1]), (goal[0], goal[1]))
        if leg is not None and len(leg):
            legs.append(leg)
            here = leg[-1]
    return np.concatenate(legs)


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
