"""Index arithmetic by hand: half-open cells, rows with y, columns with x."""

import numpy as np
import pytest
from orograph.grid import Grid
from orograph.layers import LAYERS, CellMap

GRID = Grid(origin_m=(-10.0, 20.0), cell_m=0.5, shape=(4, 6))


@pytest.mark.parametrize(
    ("x_m", "y_m", "cell"),
    [
        (-10.0, 20.0, (0, 0)),
        (-9.5, 20.0, (0, 1)),
        (-9.500001, 20.499999, (0, 0)),
        (-7.000001, 21.999999, (3, 5)),
        (-7.0, 20.0, None),
        (-10.0, 22.0, None),
        (-10.000001, 20.0, None),
    ],
)
def test_a_point_on_a_shared_edge_belongs_to_the_cell_above_and_right(
    x_m: float, y_m: float, cell: tuple[int, int] | None
) -> None:
    assert GRID.row_col(x_m, y_m) == cell
    rows, cols = GRID.rows_cols([[x_m, y_m]])
    assert bool(GRID.contains(rows, cols)[0]) == (cell is not None)
    if cell:
        assert (rows[0], cols[0]) == cell


def test_extent_and_centres() -> None:
    assert GRID.extent_m == (-10.0, 20.0, -7.0, 22.0)
    assert GRID.centre_m(0, 0) == (-9.75, 20.25)
    x, y = GRID.centres_m()
    assert x[0] == -9.75 and x[-1] == -7.25 and y[-1] == 21.75


def test_windows_refining_and_coarsening_keep_the_area() -> None:
    assert GRID.window(1, 2, (2, 2)).origin_m == (-9.0, 20.5)
    assert GRID.refined(5).coarsened(5) == GRID
    assert GRID.coarsened(2).extent_m == GRID.extent_m
    with pytest.raises(ValueError, match="multiple"):
        GRID.coarsened(4)


@pytest.mark.parametrize("bad", [{"cell_m": 0.0}, {"cell_m": float("inf")}, {"shape": (0, 3)}])
def test_a_grid_that_cannot_be_is_refused(bad: dict[str, object]) -> None:
    with pytest.raises(ValueError, match="must be"):
        Grid(**{"origin_m": (0.0, 0.0), "cell_m": 1.0, "shape": (2, 2), **bad})


def test_an_unknown_map_knows_nothing() -> None:
    blank = CellMap.unknown(GRID)
    assert [name for name, _ in blank.layers()] == list(LAYERS)
    assert not blank.known.any()
    assert np.isnan(blank.height).all()
    copy = blank.copy()
    assert copy.equals(blank)
    copy.height[0, 0] = 1.0
    assert not copy.equals(blank)
