"""The prior of a small grid, cell by cell."""

from __future__ import annotations

import numpy as np
import pytest
from orograph.layers import UNKNOWN_GRADIENT
from orograph.messages import UPDATE
from orograph.scenario import Scenario
from orograph.scene.prior import building_cover, given_layers, prior_records


def scenario(**fields) -> Scenario:
    return Scenario.model_validate(
        {
            "name": "prior", "title": "prior", "robots": 1, "starts": [{"x_m": 2, "y_m": 18}],
            "base_station_m": [2, 18], "patrol": [[2, 18]], "grid": {"cell_m": 5.0, "rows": 4, "cols": 6}, **fields,
        }
    )  # fmt: skip


def test_sloping_ground_by_hand():
    records = prior_records(scenario(terrain={"height_m": 2.0, "slope_x": 0.1, "slope_y": -0.2}))
    assert records.dtype == UPDATE
    np.testing.assert_array_equal(records["cell"], np.arange(24))
    assert set(records["seq"]) == set(records["tick"]) == {0}
    cell = records[1 * 6 + 2]  # centre (12.5, 7.5): 2 + 1.25 - 1.5 m
    assert (cell["height"], cell["gradient_x"], cell["gradient_y"]) == (1750, 1000, -2000)
    assert cell["occupation"] == round(254 * (0.1**2 + 0.2**2) ** 0.5 / 0.3)
    assert set(records["confidence"]) == {32}


def test_cells_covered_enough_hold_a_building_of_the_priors_height():
    # 5 m x 2.0 m of cell (0, 0): exactly 40 %; 1.99 m of cell (0, 2): 39.8 %; all of (2, 3) and (2, 4).
    buildings = [
        {"footprint": [[0, 0], [2.0, 0], [2.0, 5], [0, 5]], "height_m": 3.0},
        {"footprint": [[10, 0], [11.99, 0], [11.99, 5], [10, 5]], "height_m": 30.0},
        {"footprint": [[15, 10], [25, 10], [25, 15], [15, 15]], "height_m": 4.0},
    ]
    prior = {"building_height_m": 8.0, "confidence": 20}
    records = prior_records(scenario(terrain={"height_m": 1.0}, buildings=buildings, prior=prior)).reshape(4, 6)
    roofs = np.zeros((4, 6), bool)
    roofs[0, 0] = roofs[2, 3] = roofs[2, 4] = True
    np.testing.assert_array_equal(records["height"], np.where(roofs, 9000, 1000))
    np.testing.assert_array_equal(records["occupation"], np.where(roofs, 254, 0))
    np.testing.assert_array_equal(records["gradient_x"], np.where(roofs, UNKNOWN_GRADIENT, 0))
    np.testing.assert_array_equal(records["gradient_y"], np.where(roofs, UNKNOWN_GRADIENT, 0))
    assert set(records["confidence"].reshape(-1)) == {20}


def test_overlaps_count_once_and_what_lies_outside_not_at_all():
    square = [[20, 10], [22, 10], [22, 14], [20, 14]]
    outside = [[25, 15], [60, 15], [60, 80], [25, 80]]
    world = scenario(buildings=[{"footprint": corners, "height_m": 5.0} for corners in (square, square, outside)])
    cover = building_cover(world, world.grid.grid)
    assert cover[2, 4] == pytest.approx(8 / 25)
    assert cover[3, 5] == pytest.approx(1.0)
    assert cover.sum() == pytest.approx(8 / 25 + 1.0)


def test_given_layers_later_areas_win_and_edges_are_half_open():
    layers = {
        "gps_quality": {
            "default": 2,
            "areas": [{"rectangle_m": [5, 0, 20, 10], "value": 1}, {"rectangle_m": [10, 5, 15, 10], "value": 0}],
        },
        "communications": {"default": 1, "areas": [{"rectangle_m": [2.5, 2.5, 7.5, 7.5], "value": 0}]},
    }
    gps_quality, communications = given_layers(scenario(**layers))
    assert gps_quality.dtype == communications.dtype == np.float32
    np.testing.assert_array_equal(gps_quality, [[2, 1, 1, 1, 2, 2], [2, 1, 0, 1, 2, 2], [2] * 6, [2] * 6])
    # Centres at 2.5 m are on the low edge, inside; those at 7.5 m on the high edge, outside.
    np.testing.assert_array_equal(communications, [[0, 1, 1, 1, 1, 1], [1] * 6, [1] * 6, [1] * 6])
