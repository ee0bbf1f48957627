"""A click finds the cell that a person sees there: what stands in front hides what is behind."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from orograph.console.picking import cell_hit
from orograph.grid import Grid

GRID = Grid((-20.0, 10.0), 5.0, (12, 16))
INSIDE = st.tuples(st.floats(-19, 59), st.floats(11, 69))
"""Not within a step of the edge, over which a flat ray may pass the last of the ground."""


@given(INSIDE, st.tuples(st.floats(-80, 120), st.floats(-60, 140), st.floats(5, 150)))
def test_on_flat_ground_it_is_where_the_ray_meets_it(at: tuple[float, float], eye: tuple[float, float, float]) -> None:
    found = cell_hit(GRID, np.zeros(GRID.shape), np.array(eye), np.array([*at, 0.0]) - eye)
    assert found is not None
    x, y = GRID.centre_m(*found)
    # The ray is walked in steps of an eighth of a cell.
    assert abs(x - at[0]) <= 2.5 + 0.7 and abs(y - at[1]) <= 2.5 + 0.7


def test_a_wall_hides_what_is_behind_it() -> None:
    height_m = np.zeros(GRID.shape)
    height_m[6, :] = 20.0
    eye, behind = np.array([20.0, -40.0, 30.0]), np.array([20.0, 55.0, 0.0])
    assert cell_hit(GRID, height_m, eye, behind - eye) == (6, 8)


def test_the_sky_is_no_cell() -> None:
    assert cell_hit(GRID, np.zeros(GRID.shape), np.array([0.0, 0.0, 30.0]), np.array([1.0, 1.0, 0.5])) is None
    assert cell_hit(GRID, np.full(GRID.shape, np.nan), np.array([0.0, 0.0, 30.0]), np.array([1.0, 1.0, -1.0])) is None
