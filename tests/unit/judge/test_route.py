from __future__ import annotations

import math

import numpy as np
import pytest
from orograph.grid import Grid
from orograph.judge.route import patrol_poses, planned_way, resampled, shares, short_of_the_end, without_repeats
from orograph.messages import OccupancyGrid
from orograph.mission.distances import DrivingDistances
from orograph.scenario import Scenario

GRID = Grid((10.0, -20.0), 5.0, (30, 30))


def told(blocked: np.ndarray) -> OccupancyGrid:
    return OccupancyGrid(0, *GRID.origin_m, GRID.cell_m, True, np.where(blocked, 254, 0).astype(np.uint8))


def test_a_way_goes_round_a_wall_and_through_every_stop() -> None:
    blocked = np.zeros(GRID.shape, np.bool_)
    blocked[:20, 15] = True
    stops = np.array([GRID.centre_m(3, 3), GRID.centre_m(3, 26), GRID.centre_m(26, 26)])
    way = planned_way(told(blocked), stops)
    assert all(np.hypot(*(way - stop).T).min() < 1e-9 for stop in stops)
    rows, cols = GRID.rows_cols(way)
    assert not blocked[rows, cols].any()
    crossed = way[np.argmin(np.abs(way[:, 0] - GRID.centre_m(0, 15)[0]))]
    assert crossed[1] > GRID.centre_m(19, 0)[1]


def test_a_stop_off_the_map_is_left_out() -> None:
    stops = np.array([GRID.centre_m(3, 3), (-500.0, 0.0), GRID.centre_m(3, 9)])
    way = planned_way(told(np.zeros(GRID.shape, np.bool_)), stops)
    assert way[0].tolist() == list(GRID.centre_m(3, 3)) and way[-1].tolist() == list(GRID.centre_m(3, 9))
    assert np.hypot(*np.diff(way, axis=0).T).sum() == pytest.approx(30.0)


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
