"""The patrol divided over robots so that the longest tour is shortest (min-max, open tours), by OR-Tools routing.

Every search ends in a local optimum of its own: no clock and no thread takes part, so the answer never differs. What a
search costs grows with the cube of its waypoints; what all together may cost is counted, and beyond
SEARCHED_WAYPOINTS the patrol is dealt out without one.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any

import numpy as np
from ortools.constraint_solver import pywrapcp, routing_enums_pb2

from orograph.arrays import F64
from orograph.mission.cut import ROBOTS_MAX, cut
from orograph.mission.deal import deal
from orograph.mission.distances import UNREACHABLE_M

Tours = list[list[int]]

UNIT_M = 0.1
"""The solver counts in whole decimetres."""
SPAN_WEIGHTS = (3, 10, 100)
"""What a metre of the longest tour costs against a metre of all tours; none of them wins always."""
FIRST_TOURS = ("LOCAL_CHEAPEST_COST_INSERTION", "LOCAL_CHEAPEST_INSERTION", "PATH_CHEAPEST_ARC")
THOROUGH_WAYPOINTS = 32
"""Up to here every weight is tried with every first tour; beyond, where a search takes long, with one first tour."""
SEARCHED_WAYPOINTS = 100
"""Up to here a search takes 2.5 s at most; 300 would take minutes."""
SHARED_WAYPOINTS = 64
"""Up to here two robots share theirs anew."""
WORK_MAX = 6_000_000
"""Cubed waypoints of all searches of one split that only improve it: 15 s on one core, for any number of robots."""
FORCED_WAYPOINTS = 12
"""Up to here the longest tour is also made to part with each of its waypoints in turn."""
FOREVER_S = 10**9


class _Work:
    """What searches have cost, in cubed waypoints."""

    def __init__(self) -> None:
        self.done = 0

    def enough(self) -> bool:
        """No more searches that only improve."""
        return self.done >= WORK_MAX


@dataclass(frozen=True)
class _Patrol:
    """Distances (n, n) with the robots' starts first, and for each waypoint the robots that may take it."""

    distance_m: F64
    robots: int
    takers: tuple[tuple[int, ...], ...]
    work: _Work

    def length_m(self, robot: int, tour: Sequence[int]) -> float:
        """Length of an open tour from the robot's start."""
        stops = [robot, *(self.robots + w for w in tour)]
        return float(sum(self.distance_m[a, b] for a, b in pairwise(stops)))

    def barring(self, robot: int, waypoint: int) -> _Patrol:
        """The same patrol with a waypoint kept from a robot, unless nobody else may take it."""
        left = tuple(r for r in self.takers[waypoint] if r != robot) or self.takers[waypoint]
        return replace(self, takers=(*self.takers[:waypoint], left, *self.takers[waypoint + 1 :]))


def split_patrol(robots: int, distance_m: F64, barred: Sequence[Collection[int]] = ()) -> Tours:
    """Waypoints in driving order for each robot, every waypoint exactly once.

    `distance_m` (robots + waypoints, robots + waypoints) [m] has the starts first. `barred[robot]` are waypoints that
    this robot must not take unless all are barred. A waypoint that no robot reaches ends one of the shortest tours.
    """
    assert robots >= 1 and distance_m.shape[0] == distance_m.shape[1] >= robots, (robots, distance_m.shape)
    barred = barred or [()] * robots
    waypoints = range(len(distance_m) - robots)
    willing = [[r for r in range(robots) if w not in barred[r]] or list(range(robots)) for w in waypoints]
    takers = [tuple(r for r in willing[w] if distance_m[r, robots + w] < UNREACHABLE_M) for w in waypoints]
    patrol = _Patrol(distance_m, robots, tuple(takers), _Work())
    reachable = [w for w in waypoints if takers[w]]
    tours = _even_out(patrol, _first_tours(patrol, reachable))
    if len(reachable) <= FORCED_WAYPOINTS:
        tours = _part_with_one(patrol, tours, reachable)
    for w in waypoints:
        if not takers[w]:
            shortest = min(willing[w], key=lambda r: (patrol.length_m(r, tours[r]), len(tours[r]), r))
            tours[shortest].append(w)
    return tours


def longest_m(robots: int, distance_m: F64, tours: Tours) -> float:
    """Length of the longest tour [m]."""
    patrol = _Patrol(distance_m, robots, (), _Work())
    return max(patrol.length_m(robot, tour) for robot, tour in enumerate(tours))


def _first_tours(patrol: _Patrol, waypoints: list[int]) -> Tours:
    """All robots' tours over some waypoints: the better of a search and of one robot's tour cut into stretches.

    Where a search would take too long they are dealt out.
    """
    if len(waypoints) <= SEARCHED_WAYPOINTS:
        found = [_best_tours(patrol, list(range(patrol.robots)), waypoints)]
        if 1 < patrol.robots <= ROBOTS_MAX and all(len(patrol.takers[w]) == patrol.robots for w in waypoints):
            found.append(cut(patrol.distance_m, patrol.robots, _best_tours(patrol, [0], waypoints)[0]))
        return min(found, key=lambda tours: _lengths_m(patrol, range(patrol.robots), tours))
    places = [*range(patrol.robots), *(patrol.robots + w for w in waypoints)]
    may_take = np.array([[robot in patrol.takers[w] for w in waypoints] for robot in range(patrol.robots)])
    return [[waypoints[i] for i in tour] for tour in deal(patrol.distance_m[np.ix_(places, places)], may_take)]


def _best_tours(patrol: _Patrol, robots: list[int], waypoints: list[int]) -> Tours:
    """The best of several searches over some robots and waypoints, in the order of `robots`."""
    if not waypoints:
        return [[] for _ in robots]
    firsts = FIRST_TOURS if len(waypoints) <= THOROUGH_WAYPOINTS else FIRST_TOURS[:1]
    weights = SPAN_WEIGHTS if len(robots) <= 2 or len(waypoints) <= THOROUGH_WAYPOINTS else SPAN_WEIGHTS[:2]
    patrol.work.done += len(firsts) * len(weights) * len(waypoints) ** 3
    found = [_search(patrol, robots, waypoints, first, weight) for first in firsts for weight in weights]
    return min(found, key=lambda tours: _lengths_m(patrol, robots, tours))


def _lengths_m(patrol: _Patrol, robots: Sequence[int], tours: Tours) -> list[float]:
    return sorted((patrol.length_m(r, tour) for r, tour in zip(robots, tours, strict=True)), reverse=True)


def _even_out(patrol: _Patrol, tours: Tours) -> Tours:
    """Share the longest tour anew with one other robot at a time, until none of them can shorten it or it is enough."""
    lengths_m = [patrol.length_m(r, tour) for r, tour in enumerate(tours)]
    while True:
        longest = max(range(patrol.robots), key=lambda r: (lengths_m[r], -r))
        for other in sorted(set(range(patrol.robots)) - {longest}, key=lambda r: (lengths_m[r], r)):
            pair, both = [longest, other], sorted(tours[longest] + tours[other])
            if patrol.work.enough():
                return tours
            if len(both) > SHARED_WAYPOINTS:
                continue
            shared = _best_tours(patrol, pair, both)
            if _lengths_m(patrol, pair, shared)[0] < lengths_m[longest] - UNIT_M:
                for robot, tour in zip(pair, shared, strict=True):
                    tours[robot], lengths_m[robot] = tour, patrol.length_m(robot, tour)
                break
        else:
            return tours


def _part_with_one(patrol: _Patrol, tours: Tours, waypoints: list[int]) -> Tours:
    """Search anew with one waypoint of the longest tour barred to its robot, as long as that shortens the longest."""
    robots = list(range(patrol.robots))
    while True:
        lengths_m = [patrol.length_m(r, tour) for r, tour in enumerate(tours)]
        longest = int(np.argmax(lengths_m))
        forced = [_best_tours(patrol.barring(longest, w), robots, waypoints) for w in tours[longest]]
        best = min([tours, *forced], key=lambda found: _lengths_m(patrol, robots, found)[0])
        if patrol.work.enough() or _lengths_m(patrol, robots, best)[0] >= lengths_m[longest] - UNIT_M:
            return tours
        tours = _even_out(patrol, best)


def _search(patrol: _Patrol, robots: list[int], waypoints: list[int], first: str, weight: int) -> Tours:
    places = [*robots, *(patrol.robots + w for w in waypoints)]
    end = len(places)
    manager = pywrapcp.RoutingIndexManager(end + 1, len(robots), list(range(len(robots))), [end] * len(robots))
    routing = pywrapcp.RoutingModel(manager)
    cost = np.zeros((end + 1, end + 1), np.int64)
    cost[:end, :end] = np.round(patrol.distance_m[np.ix_(places, places)] / UNIT_M)
    transit = routing.RegisterTransitMatrix(cost.tolist())
    routing.SetArcCostEvaluatorOfAllVehicles(transit)
    routing.AddDimension(transit, 0, int(cost.sum()) + 1, True, "driven")
    routing.GetDimensionOrDie("driven").SetGlobalSpanCostCoefficient(weight)
    for i, w in enumerate(waypoints):
        vehicles = [v for v, r in enumerate(robots) if r in patrol.takers[w]]
        if len(vehicles) < len(robots):
            routing.VehicleVar(manager.NodeToIndex(len(robots) + i)).SetValues(vehicles)
    solution = routing.SolveWithParameters(_parameters(first))
    assert solution is not None, "a patrol without limits always has a solution"
    return [_tour(routing, manager, solution, v, waypoints) for v in range(len(robots))]


def _parameters(first: str) -> Any:
    parameters = pywrapcp.DefaultRoutingSearchParameters()
    parameters.first_solution_strategy = getattr(routing_enums_pb2.FirstSolutionStrategy, first)
    parameters.local_search_metaheuristic = routing_enums_pb2.LocalSearchMetaheuristic.GREEDY_DESCENT
    parameters.lns_time_limit.seconds = FOREVER_S  # the default, 0.1 s of wall time, would differ by machine
    return parameters


def _tour(routing: Any, manager: Any, solution: Any, vehicle: int, waypoints: list[int]) -> list[int]:
    tour, index = [], solution.Value(routing.NextVar(routing.Start(vehicle)))
    while not routing.IsEnd(index):
        tour.append(waypoints[manager.IndexToNode(index) - routing.vehicles()])
        index = solution.Value(routing.NextVar(index))
    return tour
