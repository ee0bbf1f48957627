from __future__ import annotations

import re
from urllib.parse import unquote

import numpy as np
import pytest
from orograph.grid import Grid
from orograph.report import surfaces
from orograph.report.axonometric import MAX_CELLS, TILT_RAD, TURN_RAD, Relief, depth, project, thinned
from orograph.report.maps import shown_extent, window_of
from orograph.report.page import change, fixed


def test_the_view_by_hand() -> None:
    one, zero = np.ones(1), np.zeros(1)
    assert project(zero, zero, one)[0] == pytest.approx([0.0, np.cos(TILT_RAD)])
    assert project(one, zero, zero)[0] == pytest.approx([np.cos(TURN_RAD), np.sin(TURN_RAD) * np.sin(TILT_RAD)])
    # What is farther north or east is farther away.
    assert depth(zero, one)[0] > 0
    assert depth(one, zero)[0] > 0


def test_a_map_of_nothing_has_a_picture_too() -> None:
    nothing = Relief(Grid((0.0, 0.0), 1.0, (3, 4)), np.full((3, 4), np.nan))
    assert nothing.span_m == (0.0, 0.0)
    picture = surfaces.surface(nothing, (0.0, 1.0), "nothing", "nothing")
    assert picture.height > 50 and "x east [m]" in unquote(picture.source)


def test_thinning_keeps_towers() -> None:
    side = int(np.sqrt(MAX_CELLS)) * 2
    height = np.zeros((side, side))
    height[5, 7] = 30.0
    height[0:2, 0:2] = np.nan
    thin = thinned(Relief(Grid((0.0, 0.0), 1.0, (side, side)), height))
    assert thin.grid.cell_m == 2.0
    assert thin.height_m[2, 3] == 30.0
    assert np.isnan(thin.height_m[0, 0])
    assert thinned(thin) is thin


def test_colour_limits_leave_out_single_towers() -> None:
    layer = np.concatenate([np.zeros(990), np.full(990, 10.0), [900.0]])
    low, high = surfaces.height_limits(layer, np.array([np.nan]))
    assert (low, high) == (0.0, 10.0)
    assert surfaces.height_limits(np.array([np.nan])) == (0.0, 1.0)


def test_a_picture_keeps_its_words_as_text_and_has_no_date() -> None:
    relief = Relief(Grid((0.0, 0.0), 1.0, (4, 5)), np.arange(20.0).reshape(4, 5))
    picture = surfaces.surface(relief, (0.0, 20.0), "caption", "alt")
    svg = unquote(picture.source.removeprefix("data:image/svg+xml,"))
    assert "x east [m]" in svg
    assert "height [m]" in svg
    assert "<dc:date>" not in svg
    assert not re.search(r'(?:href|src)="(?!data:|#)', svg)


def test_the_shown_part_is_what_is_interesting_with_a_margin() -> None:
    grid = Grid((100.0, 0.0), 5.0, (40, 40))
    seen = np.zeros(grid.shape, np.bool_)
    assert shown_extent(grid, seen) == (100.0, 300.0, 0.0, 200.0)
    seen[10, 20] = True
    assert shown_extent(grid, seen, 25.0) == (175.0, 230.0, 25.0, 80.0)
    seen[0, 39] = True
    assert shown_extent(grid, seen, 25.0) == (175.0, 300.0, 0.0, 80.0)


def test_a_window_holds_the_cells_of_an_extent() -> None:
    grid = Grid((10.0, 20.0), 5.0, (6, 8))
    window, (rows, cols) = window_of(grid, (20.0, 35.0, 25.0, 35.0))
    assert (window.extent_m, window.shape) == ((20.0, 25.0, 35.0, 35.0), (2, 3))
    assert np.zeros(grid.shape)[rows, cols].shape == window.shape
    x0, y0, x1, y1 = grid.extent_m
    assert window_of(grid, (x0, x1, y0, y1))[0] == grid


def test_better_and_worse_are_told_where_the_digits_tell_them() -> None:
    assert [change(0.2, 0.1, 2, -1), change(0.2, 0.3, 2, -1), change(0.2, 0.201, 2, -1)] == ["better", "worse", ""]
    assert [change(0.2, 0.3, 2, 1), change(0.2, 0.1, 2, 1)] == ["better", "worse"]
    assert change(float("nan"), 0.1, 2, 1) == change(0.1, float("nan"), 2, 1) == ""


def test_numbers_as_people_read_them() -> None:
    assert fixed(1234.567, 1) == "1\u202f234.6"
    assert fixed(-0.5) == "\u22120.50"
    assert fixed(-0.001) == "0.00"
    assert (fixed(None), fixed(float("nan"))) == ("–", "–")
