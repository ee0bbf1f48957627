"""Driving distances against hand-computed cases and a plain Bellman-Ford search."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from orograph.grid import Grid
from orograph.mission.distances import UNREACHABLE_M, DrivingDistances


def reference(free: np.ndarray, start: tuple[int, int], cell_m: float) -> np.ndarray:
    """Shortest drives from one cell by relaxing every step until nothing improves."""
    rows, cols = free.shape
    reach = np.full(free.shape, np.inf)
    reach[start] = 0.0
    steps = [(dr, dc) for dr in (-1, 0, 1) for dc in (-1, 0, 1) if dr or dc]
    changed = True
    while changed:
        changed = False
        for r in range(rows):
            for c in range(cols):
                for dr, dc in steps:
                    nr, nc = r + dr, c + dc
                    if not (0 <= nr < rows and 0 <= nc < cols and free[r, c] and free[nr, nc]):
                        continue
                    if not (free[r, nc] and free[nr, c]):
                        continue
                    length = reach[r, c] + cell_m * math.hypot(dr, dc)
                    if length < reach[nr, nc] - 1e-9:
                        reach[nr, nc], changed = length, True
    return reach


@settings(max_examples=60, deadline=None)
@given(hnp.arrays(np.bool_, st.tuples(st.integers(1, 6), st.integers(1, 7))), st.data())
def test_equals_a_plain_search(free: np.ndarray, data: st.DataObject) -> None:
    cells = [tuple(cell) for cell in np.argwhere(free).tolist()]
    if not cells:
        return
    start = data.draw(st.sampled_from(cells))
    grid = Grid((10.0, -20.0), 5.0, free.shape)
    roads = DrivingDistances(np.where(free, 0.0, 1.0), grid)
    got = roads.between([grid.centre_m(*start)], [grid.centre_m(*cell) for cell in cells])[0]
    wanted = reference(free, start, 5.0)[tuple(np.array(cells).T)]
    np.testing.assert_allclose(got, np.minimum(wanted, UNREACHABLE_M), rtol=1e-12)


def test_a_wall_costs_the_way_round_it() -> None:
    occupation = np.zeros((5, 5))
    occupation[0:4, 2] = 1.0  # open only in the top row
    grid = Grid((0.0, 0.0), 5.0, (5, 5))
    there = DrivingDistances(occupation, grid).between([(7.5, 2.5)], [(17.5, 2.5)])
    assert there[0, 0] == pytest.approx(2 * (4 * 5.0) + 2 * 5.0)  # four up, two across, four down: no corner is cut


def test_unknown_is_free_and_places_in_obstacles_move_out() -> None:
    occupation = np.array([[np.nan, 0.94, 0.95, 0.0]])
    grid = Grid((0.0, 0.0), 5.0, (1, 4))
    roads = DrivingDistances(occupation, grid)
    assert roads.between([(2.5, 2.5)], [(7.5, 2.5), (17.5, 2.5)]).tolist() == [[5.0, UNREACHABLE_M]]
    assert roads.between([(14.0, 2.5)], [(17.5, 2.5)]).tolist() == [[0.0]]


def test_nothing_free_and_nothing_asked() -> None:
    roads = DrivingDistances(np.ones((2, 2)), Grid((0.0, 0.0), 5.0, (2, 2)))
    assert roads.between([(1.0, 1.0)], []).shape == (1, 0)
    assert roads.between([(1.0, 1.0)], [(9.0, 9.0)]).tolist() == [[0.0]]


def test_the_largest_island_is_kept() -> None:
    occupation = np.zeros((10, 10))
    occupation[:, 4] = 1.0
    roads = DrivingDistances(occupation, Grid((0.0, 0.0), 1.0, (10, 10)))
    assert roads.reachable_together([(1.5, 1.5), (7.5, 1.5), (8.5, 8.5), (6.5, 2.5), (2.5, 9.5)]).tolist() == [1, 2, 3]
