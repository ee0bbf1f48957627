from __future__ import annotations

import heapq
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from orograph.grid import Grid
from orograph.mission.distances import DrivingDistances
from orograph.report.route import patrol_poses, resampled, shares, short_of_the_end, shortest_way, without_repeats
from orograph.scenario import Scenario

SIDE = 6
GRID = Grid((10.0, -20.0), 5.0, (SIDE, SIDE))


def plain_distance(free: np.ndarray, start: tuple[int, int], goal: tuple[int, int]) -> float:
    """Textbook Dijkstra, corners not cut."""
    best, queue = {start: 0.0}, [(0.0, start)]
    while queue:
        d, (r, c) = heapq.heappop(queue)
        if (r, c) == goal:
            return d
        for dr in (-1, 0, 1):
            for dc in (-1, 0, 1):
                to = (r + dr, c + dc)
                if to == (r, c) or not (0 <= to[0] < SIDE and 0 <= to[1] < SIDE):
                    continue
                if (
                    free[to]
                    and free[r, to[1]]
                    and free[to[0], c]
                    and d + 5 * math.hypot(dr, dc) < best.get(to, math.inf)
                ):
                    best[to] = d + 5 * math.hypot(dr, dc)
                    heapq.heappush(queue, (best[to], to))
    return math.inf


@settings(max_examples=60, deadline=None)
@given(
    st.lists(st.booleans(), min_size=SIDE**2, max_size=SIDE**2),
    st.integers(0, SIDE**2 - 1),
    st.integers(0, SIDE**2 - 1),
)
def test_ways_are_shortest(blocked: list[bool], start: int, goal: int) -> None:
    free = ~np.array(blocked).reshape(SIDE, SIDE)
    a, b = divmod(start, SIDE), divmod(goal, SIDE)
    free[a] = free[b] = True
    way = shortest_way(free, GRID, np.array([GRID.centre_m(*a), GRID.centre_m(*b)]))
    expected = plain_distance(free, a, b)
    if math.isinf(expected):
        assert len(way) == 1
        return
    assert way[0].tolist() == list(GRID.centre_m(*a))
    assert way[-1].tolist() == list(GRID.centre_m(*b))
    assert np.hypot(*np.diff(way, axis=0).T).sum() == pytest.approx(expected)


def test_a_blocked_stop_is_reached_at_its_nearest_free_cell_and_a_walled_one_left_out() -> None:
    free = np.ones((SIDE, SIDE), np.bool_)
    free[:, 3] = False
    stops = np.array([GRID.centre_m(0, 0), GRID.centre_m(0, 5), GRID.centre_m(2, 3) - np.array([0.5, 0.0])])
    way = shortest_way(free, GRID, stops)
    assert way[-1].tolist() == list(GRID.centre_m(2, 2))


def test_resampling_keeps_its_distance_and_faces_ahead() -> None:
    poses = resampled(np.array([[0.0, 0.0], [3.0, 0.0], [3.0, 0.0], [3.0, 4.0]]), 2.0)
    assert poses[:, :2].tolist() == [[0, 0], [2, 0], [3, 1], [3, 3]]
    assert poses[:, 2].tolist() == pytest.approx([0, 0, math.pi / 2, math.pi / 2])
    assert resampled(np.array([[1.0, 2.0]]), 2.0).tolist() == [[1.0, 2.0, 0.0]]


def test_no_stretch_is_scanned_twice() -> None:
    there_and_back = resampled(np.array([[0.0, 0.0], [20.0, 0.0], [0.0, 0.0]]), 2.0)
    assert len(without_repeats(there_and_back, 2.0)) == 11


def test_the_last_metres_before_the_last_waypoint_are_not_driven() -> None:
    poses = resampled(np.array([[0.0, 0.0], [21.0, 0.0]]), 1.0)
    assert short_of_the_end(poses)[-1].tolist() == [15.0, 0.0, 0.0]
    assert short_of_the_end(poses[:3]).tolist() == [[0.0, 0.0, 0.0]]


def test_every_waypoint_is_in_one_robots_share(city_scenario: Scenario) -> None:
    roads = DrivingDistances(np.zeros(city_scenario.grid.grid.shape), city_scenario.grid.grid)
    found = shares(city_scenario, roads)
    assert [s[0].tolist() for s in found] == [[s.x_m, s.y_m] for s in city_scenario.starts]
    visited = sorted(tuple(stop) for share in found for stop in share[1:].tolist())
    assert visited == sorted(city_scenario.patrol)


def test_the_patrol_of_a_scenario_stays_on_free_ground(city_scenario: Scenario) -> None:
    poses = patrol_poses(city_scenario, 2.0)
    assert len(poses) > 60
    for building in city_scenario.buildings:
        (x0, y0), (x1, y1) = np.min(building.footprint, axis=0), np.max(building.footprint, axis=0)
        inside = (poses[:, 0] > x0) & (poses[:, 0] < x1) & (poses[:, 1] > y0) & (poses[:, 1] < y1)
        assert not inside.any()
