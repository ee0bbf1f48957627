"""The truth of small scenes by hand: what is built up, how high, where the ground is."""

from __future__ import annotations

import numpy as np
from orograph.grid import Grid
from orograph.judge.map_truth import MapTruth, true_map, window
from orograph.scene import build_scene

HOUSE = {"footprint": [[20, 20], [30, 20], [30, 30], [20, 30]], "height_m": 6.0}
SHED = {"footprint": [[52, 40], [55, 40], [55, 45], [52, 45]], "height_m": 3.0}
"""3 m of a 5 m cell: 60 % of (8, 10)."""
FENCE = {"footprint": [[71, 40], [72, 40], [72, 45], [71, 45]], "height_m": 2.0}
"""20 % of (8, 14): the cell is open, and beside a wall."""


def truth_of(flat_world, places: int = 10, **fields) -> MapTruth:
    scenario = flat_world(buildings=[HOUSE, SHED, FENCE], **fields)
    return true_map(build_scene(scenario), scenario.grid.grid, places, near_cells=1)


def test_roofs_their_tops_and_what_is_near_them(flat_world):
    truth = truth_of(flat_world)
    roofs = {(r, c) for r in (4, 5) for c in (4, 5)} | {(8, 10)}
    assert set(zip(*(a.tolist() for a in np.nonzero(truth.roof)), strict=True)) == roofs
    assert [truth.top_m[cell].round(3) for cell in ((4, 4), (8, 10), (8, 14))] == [6.0, 3.0, 2.0]
    assert np.isnan(truth.top_m[7, 10]) and np.isnan(truth.top_m[0, 0])
    built = [*roofs, (8, 14)]
    for row in range(40):
        for col in range(40):
            beside = any(abs(row - r) <= 1 and abs(col - c) <= 1 for r, c in built)
            assert truth.near[row, col] == (beside and (row, col) not in roofs), (row, col)
            assert truth.clear[row, col] == (not beside), (row, col)
    assert not truth.steep.any()
    np.testing.assert_array_equal(truth.barred, truth.roof)


def test_the_ground_is_that_of_the_open_part(flat_world):
    truth = truth_of(flat_world, terrain={"height_m": 1.0, "slope_x": 0.1})
    x, _ = Grid((0.0, 0.0), 5.0, (40, 40)).centres_m()
    np.testing.assert_allclose(truth.ground_m[0], 1.0 + 0.1 * x, atol=1e-9)
    # Open in cell (8, 10) are x = 50-52 m, every 0.5 m from 50.25 m on: their mean is 51 m.
    np.testing.assert_allclose(truth.ground_m[8, 10], 1.0 + 0.1 * 51.0, atol=1e-9)
    np.testing.assert_allclose(truth.ground_m[4, 4], 1.0 + 0.1 * 22.5, atol=1e-9)  # all built up: its centre


def test_steep_ground_bars(flat_world):
    truth = truth_of(flat_world, terrain={"slope_y": 0.29}, robot={"slope_max": 0.25})
    assert truth.steep.all() and truth.barred.all() and not truth.clear.any()


def test_strips_change_nothing(flat_world, monkeypatch):
    whole = truth_of(flat_world, places=4)
    monkeypatch.setattr("orograph.judge.map_truth.PLACES_AT_A_TIME", 40 * 16 * 7)
    strips = truth_of(flat_world, places=4)
    for name in ("ground_m", "top_m", "roof", "steep", "near"):
        np.testing.assert_array_equal(getattr(whole, name), getattr(strips, name))


def test_a_window_may_hang_over_the_edge(flat_world):
    truth = truth_of(flat_world)
    part = truth.over(truth.grid.window(-2, 3, (8, 4)))
    assert np.isnan(part.ground_m[:2]).all() and not part.roof[:2].any()
    np.testing.assert_array_equal(part.roof[2:], truth.roof[:6, 3:7])
    away = window(truth.roof, truth.grid, truth.grid.window(60, 60, (3, 3)), True)
    assert away.all()
