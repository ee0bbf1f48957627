"""Patrols too large to search: dealt out waypoint by waypoint, then evened out, in rounds that are counted."""

from __future__ import annotations

import numpy as np

from orograph.arrays import F64, I64, Mask
from orograph.mission.deal_kernels import uncross

PASSES = 20
"""Over all pairs of a tour's stretches; ten are enough for 2 000 waypoints."""
ROUNDS_PER_ROBOT = 20
"""Waypoints that the then longest tour gives away."""


def deal(distance_m: F64, may_take: Mask) -> list[list[int]]:
    """Tours over all waypoints for each robot, not much longer than the shortest longest: no search, no clock.

    `distance_m` (robots + waypoints, robots + waypoints) [m] has the starts first; `may_take` (robots, waypoints) has
    a robot for every waypoint.
    """
    robots = len(may_take)
    tours = [_uncrossed(distance_m, tour) for tour in _grown(distance_m, may_take)]
    for _ in range(ROUNDS_PER_ROBOT * robots):
        lengths_m = np.array([_length_m(distance_m, tour) for tour in tours])
        longest = int(np.argmax(lengths_m))
        if not _give_away(distance_m, may_take, tours, lengths_m, longest):
            break
    return [[int(place) - robots for place in tour[1:]] for tour in tours]


def _grown(distance_m: F64, may_take: Mask) -> list[I64]:
    """Places from each start on: the shortest tour takes the nearest of what is left, until all is taken."""
    robots, left = len(may_take), may_take.copy()
    tours, lengths_m = [[robot] for robot in range(robots)], np.zeros(robots)
    while left.any():
        robot = int(np.argmin(np.where(left.any(axis=1), lengths_m, np.inf)))
        away_m = np.where(left[robot], distance_m[tours[robot][-1], robots:], np.inf)
        waypoint = int(np.argmin(away_m))
        tours[robot].append(robots + waypoint)
        lengths_m[robot] += away_m[waypoint]
        left[:, waypoint] = False
    return [np.array(tour, np.int64) for tour in tours]


def _uncrossed(distance_m: F64, tour: I64) -> I64:
    uncross(distance_m, tour, PASSES)
    return tour


def _length_m(distance_m: F64, tour: I64) -> float:
    return float(distance_m[tour[:-1], tour[1:]].sum())


def _give_away(distance_m: F64, may_take: Mask, tours: list[I64], lengths_m: F64, longest: int) -> bool:
    """Move a waypoint of the longest tour to where the longer of both tours becomes shortest; False if none helps."""
    tour, robots = tours[longest], len(may_take)
    saved_m = distance_m[tour[:-1], tour[1:]]  # without the k-th stop: its way there and on, less the bridge
    saved_m[:-1] += distance_m[tour[1:-1], tour[2:]] - distance_m[tour[:-2], tour[2:]]
    best_m, move = float(lengths_m[longest]) - 1e-6, None
    for robot in np.argsort(lengths_m, kind="stable").tolist():
        if robot == longest or lengths_m[robot] >= best_m:
            continue
        other, stops = tours[robot], tour[1:]
        detour_m = distance_m[np.ix_(stops, other)]  # a stop after each place of the other tour; at its end no way back
        detour_m[:, :-1] += distance_m[np.ix_(stops, other[1:])] - distance_m[other[:-1], other[1:]]
        after_m = np.maximum(lengths_m[longest] - saved_m[:, None], lengths_m[robot] + detour_m)
        after_m[~may_take[robot, stops - robots]] = np.inf
        stop, place = divmod(int(np.argmin(after_m)), len(other))
        if after_m[stop, place] < best_m:
            best_m, move = float(after_m[stop, place]), (robot, stop + 1, place + 1)
    if move is None:
        return False
    robot, stop, place = move
    tours[robot] = _uncrossed(distance_m, np.insert(tours[robot], place, tour[stop]))
    tours[longest] = _uncrossed(distance_m, np.delete(tour, stop))
    return True
