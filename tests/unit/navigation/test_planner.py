"""Planner against scipy's Dijkstra, distance transform and hand-made streets."""

import itertools
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from orograph.messages import OccupancyGrid
from orograph.navigation.planner import (
    LETHAL_M,
    blocked_in,
    global_route,
    local_path,
    local_target,
    local_window,
    planning_grid,
)
from orograph.navigation.planner_kernels import (
    blocked_cells,
    first_blocked,
    least_cost_path,
    nearest_finite,
    obstacle_distance,
    obstacle_near_m,
)
from scipy.ndimage import distance_transform_edt
from scipy.sparse import coo_array
from scipy.sparse.csgraph import dijkstra


def random_cost(seed, rows, cols, share):
    rng = np.random.default_rng(seed)
    cost = 1.0 + 4.0 * rng.random((rows, cols))
    cost[rng.random((rows, cols)) < share] = np.inf
    return cost


def edges(cost):
    """All permitted steps as (from, to, weight), written out cell by cell."""
    rows, cols = cost.shape
    for r in range(rows):
        for c in range(cols):
            for dr, dc in [(0, 1), (1, 0), (1, 1), (1, -1), (0, -1), (-1, 0), (-1, -1), (-1, 1)]:
                rr, cc = r + dr, c + dc
                if not (0 <= rr < rows and 0 <= cc < cols) or math.isinf(cost[r, c]) or math.isinf(cost[rr, cc]):
                    continue
                if dr and dc and (math.isinf(cost[r, cc]) or math.isinf(cost[rr, c])):
                    continue
                yield r * cols + c, rr * cols + cc, math.hypot(dr, dc) * (cost[r, c] + cost[rr, cc]) / 2


def cheapest(cost, start, goal):
    table = list(edges(cost))
    if not table:
        return 0.0 if start == goal else math.inf
    a, b, w = zip(*table, strict=True)
    return float(dijkstra(coo_array((w, (a, b)), shape=(cost.size, cost.size)).tocsr(), indices=start)[goal])


@settings(max_examples=60, deadline=None)
@given(st.integers(0, 2**32 - 1), st.integers(1, 14), st.integers(1, 14), st.floats(0, 0.5), st.data())
def test_a_star_costs_what_dijkstra_says_and_takes_permitted_steps(seed, rows, cols, share, data):
    cost = random_cost(seed, rows, cols, share)
    start, goal = (data.draw(st.integers(0, cost.size - 1)) for _ in range(2))
    cost.flat[start] = cost.flat[goal] = 1.0
    path, spent = least_cost_path(cost, start, goal)
    assert spent == pytest.approx(cheapest(cost, start, goal), rel=1e-12)
    assert (len(path) == 0) == math.isinf(spent)
    if len(path):
        weights = {(a, b): w for a, b, w in edges(cost)}
        assert (path[0], path[-1]) == (start, goal)
        assert sum(weights[a, b] for a, b in zip(path[:-1].tolist(), path[1:].tolist(), strict=True)) == pytest.approx(
            spent
        )


def test_corners_are_not_cut():
    cost = np.ones((3, 3))
    cost[0, 1] = cost[1, 0] = np.inf
    assert least_cost_path(cost, 0, 8)[1] == np.inf
    cost[1, 0] = 1.0
    assert least_cost_path(cost, 0, 4)[1] == 2.0
    assert least_cost_path(cost, 3, 7)[1] == pytest.approx(math.sqrt(2))


def test_equal_ways_are_chosen_alike():
    cost = np.ones((21, 21))
    cost[8:13, 10] = np.inf
    first = least_cost_path(cost, 10 * 21, 10 * 21 + 20)[0]
    for _ in range(3):
        np.testing.assert_array_equal(least_cost_path(cost.copy(), 10 * 21, 10 * 21 + 20)[0], first)


@settings(max_examples=40, deadline=None)
@given(st.integers(0, 2**32 - 1), st.integers(1, 20), st.integers(1, 20), st.floats(0, 0.6), st.integers(1, 6))
def test_obstacle_distance_is_scipys_up_to_its_reach(seed, rows, cols, share, reach):
    blocked = np.random.default_rng(seed).random((rows, cols)) < share
    expected = distance_transform_edt(~blocked) if blocked.any() else np.full((rows, cols), np.inf)
    got = obstacle_distance(blocked, reach)
    near = expected <= reach
    np.testing.assert_allclose(got[near], expected[near])
    assert (got[~near] > reach).all()


def test_a_blocked_cell_all_alone_is_noise():
    occupation = np.zeros((6, 6), np.uint8)
    occupation[1, 1] = occupation[3, 3] = occupation[4, 4] = 254
    occupation[1, 5] = 255
    assert np.argwhere(blocked_cells(occupation, 242, 255, False)).tolist() == [[3, 3], [4, 4]]
    assert np.argwhere(blocked_cells(occupation, 242, 255, True)).tolist() == [[1, 1], [3, 3], [4, 4]]


@settings(max_examples=40, deadline=None)
@given(st.integers(0, 2**32 - 1), st.integers(0, 9), st.integers(0, 9), st.integers(1, 8))
def test_nearest_finite_is_the_nearest(seed, row, col, reach):
    cost = random_cost(seed, 10, 10, 0.9)
    r, c = np.nonzero(np.isfinite(cost))
    squared = (r - row) ** 2 + (c - col) ** 2
    got = nearest_finite(cost, row, col, reach)
    inside = squared <= reach**2
    if not inside.any():
        assert got == -1
    else:
        assert (got // 10 - row) ** 2 + (got % 10 - col) ** 2 == squared[inside].min()


@settings(max_examples=40, deadline=None)
@given(st.integers(0, 2**32 - 1), st.floats(0, 8), st.floats(0, 8), st.floats(0.3, 3))
def test_obstacle_near_is_the_nearest_accompanied_cell(seed, x, y, reach):
    rng = np.random.default_rng(seed)
    occupation = np.where(rng.random((16, 16)) < 0.15, 254, 0).astype(np.uint8)
    occupation[[0, -1]] = 0
    occupation[:, [0, -1]] = 0  # an edge cell is not looked at: the map ends there
    blocked = np.argwhere(blocked_cells(occupation, 242, 255, False))
    distances = [math.hypot((c + 0.5) * 0.5 - x, (r + 0.5) * 0.5 - y) for r, c in blocked]
    expected = min([*distances, reach])
    assert obstacle_near_m(x, y, occupation, (0.0, 0.0, 0.5), 242, 255, reach) == pytest.approx(expected)


def test_first_blocked_names_the_first_point_in_range():
    occupation = np.zeros((20, 20), np.uint8)
    occupation[9:11, 14] = 254
    path = np.column_stack([np.arange(0.25, 9.0, 0.5), np.full(18, 5.0)])
    arguments = (occupation, (0.0, 0.0, 0.5), 242, 255, 0.7)
    assert first_blocked(path, 0, 18, *arguments) == 13  # x = 6.75; the cells' centres at x = 7.25, 0.25 m beside it
    assert first_blocked(path, 0, 13, *arguments) == -1
    assert first_blocked(path, 16, 18, *arguments) == -1


# --- maps ----------------------------------------------------------------------------------------------------------


def coarse(blocked=(), side=12):
    occupation = np.zeros((side, side), np.uint8)
    for row, col in blocked:
        occupation[row, col] = 254
    return OccupancyGrid(0, 0.0, 0.0, 5.0, True, occupation)


def fine(boxes=(), side=120):
    """HRM-like map at 0.5 m over the same area as `coarse`; boxes are [x0, y0, x1, y1]."""
    occupation = np.zeros((side, side), np.uint8)
    for x0, y0, x1, y1 in boxes:
        occupation[int(2 * y0) : int(2 * y1), int(2 * x0) : int(2 * x1)] = 254
    return OccupancyGrid(0, 0.0, 0.0, 0.5, False, occupation)


def walk(path):
    """Points every 5 cm along a path."""
    return np.concatenate([np.linspace(a, b, 11) for a, b in itertools.pairwise(path)])


def gap_to(boxes, points):
    out = np.inf
    for x0, y0, x1, y1 in boxes:
        dx = np.maximum(np.maximum(x0 - points[:, 0], points[:, 0] - x1), 0)
        dy = np.maximum(np.maximum(y0 - points[:, 1], points[:, 1] - y1), 0)
        out = min(out, float(np.hypot(dx, dy).min()))
    return out


def test_the_global_route_goes_round_a_building_and_ends_at_the_goal():
    wall = [(r, 6) for r in range(11)]
    route = global_route(coarse(wall), (12.0, 12.0), (52.0, 13.0))
    assert route[-1].tolist() == [52.0, 13.0]
    assert route[:, 1].max() > 55
    assert not {(int(y // 5), int(x // 5)) for x, y in walk(route)} & set(wall)


def test_the_global_route_keeps_off_walls_where_there_is_room():
    route = global_route(coarse([(4, c) for c in range(3, 9)]), (2.5, 27.5), (57.5, 27.5))
    assert route[:, 1].max() >= 32.5


def test_closed_in_by_coarse_cells_the_route_still_leads_there():
    wall = [(r, 6) for r in range(12)]
    route = global_route(coarse(wall), (12.0, 12.0), (52.0, 13.0))
    assert route is not None
    assert route[-1].tolist() == [52.0, 13.0]


def test_shut_cells_are_gone_round_and_used_only_in_need():
    route = global_route(coarse(), (2.5, 27.5), (57.5, 27.5), [(5, 6), (4, 6), (6, 6)])
    assert not ((np.abs(route[:, 0] - 32.5) < 1) & (np.abs(route[:, 1] - 27.5) < 6)).any()
    whole = global_route(coarse(), (2.5, 27.5), (57.5, 27.5), [(r, 6) for r in range(12)])
    assert whole[-1].tolist() == [57.5, 27.5]


def test_a_goal_in_a_building_moves_to_the_nearest_free_cell():
    route = global_route(coarse([(5, 10), (5, 11), (4, 11), (6, 11)]), (2.5, 27.5), (57.5, 27.5))
    assert route[-1].tolist() in ([52.5, 22.5], [52.5, 32.5])


def test_off_the_map_there_is_no_route():
    assert global_route(coarse(), (-1.0, 5.0), (10.0, 10.0)) is None
    assert global_route(coarse(), (1.0, 5.0), (10.0, 61.0)) is None


def test_the_window_is_aligned_and_clipped():
    window = local_window(fine(), (5.2, 30.0))
    assert (window.x0_m, window.y0_m) == (0.0, 0.0)
    assert window.occupation.shape == (120, 10 + 64)
    assert local_window(fine(), (61.0, 30.0)) is None


def test_the_local_target_is_where_the_route_leaves_the_window():
    route = np.column_stack([np.arange(2.5, 100, 5.0), np.full(20, 30.0)])
    grid = planning_grid(fine())
    assert local_target(route, (20.0, 31.0), grid) == ((57.5, 30.0), False)
    assert local_target(route[:8], (20.0, 31.0), grid) == ((37.5, 30.0), True)


def test_the_local_path_passes_a_box_with_room_for_the_body():
    boxes = [(25.0, 20.0, 27.0, 33.0)]
    path = local_path(fine(boxes), (15.0, 30.0), [(40.0, 30.0)], coarse())
    assert gap_to(boxes, walk(path.xy_m)) > 0.47
    assert not path.suspect
    np.testing.assert_allclose(path.xy_m[-1], (40.25, 30.25))
    assert path.legs == (len(path.xy_m) - 1,)


def test_the_local_path_keeps_to_the_middle_of_a_street():
    street = [(5.0, 0.0, 55.0, 25.0), (5.0, 31.0, 55.0, 60.0)]
    path = local_path(fine(street), (10.0, 26.5), [(50.0, 26.5)], coarse())
    middle = path.xy_m[(path.xy_m[:, 0] > 15) & (path.xy_m[:, 0] < 45), 1]
    assert np.abs(middle - 28.0).max() < 0.6


def test_two_targets_make_one_path_by_way_of_the_first():
    path = local_path(fine(), (15.0, 30.0), [(30.0, 30.0), (30.0, 45.0)], coarse())
    assert len(path.legs) == 2
    assert math.dist(path.xy_m[path.legs[0]], (30.0, 30.0)) < 2.0, "corners are rounded, not cut"
    assert math.dist(path.xy_m[-1], (30.0, 45.0)) < 0.5


def test_a_barrier_across_is_suspected_only_where_the_prior_knows_no_building():
    barrier = [(25.0, 0.0, 26.0, 60.0)]
    path = local_path(fine(barrier), (15.0, 30.0), [(40.0, 30.0)], coarse())
    assert path.suspect
    assert local_path(fine(barrier), (15.0, 30.0), [(40.0, 30.0)], coarse([(r, 5) for r in range(12)])) is None


def test_a_robot_inside_the_margin_may_leave_it():
    boxes = [(10.0, 20.0, 20.0, 29.6)]
    path = local_path(fine(boxes), (15.0, 29.8), [(40.0, 35.0)], coarse())
    assert path is not None
    assert not path.suspect
    assert path.clearance_m[0] < LETHAL_M <= path.clearance_m[4:].min()


def test_a_target_inside_a_box_ends_the_path_beside_it():
    path = local_path(fine([(37.0, 25.0, 47.0, 35.0)]), (15.0, 30.0), [(42.0, 30.0), (55.0, 30.0)], coarse())
    assert path.legs == (len(path.xy_m) - 1,), "it does not go on: the waypoint may not count as visited"
    assert 0.7 < gap_to([(37.0, 25.0, 47.0, 35.0)], path.xy_m[-1:]) < 1.5


def test_blocked_in_looks_up_the_other_map():
    window = local_window(fine(), (30.0, 30.0))
    blocked = blocked_in(coarse([(2, 3)]), planning_grid(window))
    rows, cols = np.nonzero(blocked)
    assert (rows.min(), rows.max(), cols.min(), cols.max()) == (20, 29, 30, 39)
    assert blocked.sum() == 100
