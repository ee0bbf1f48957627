"""The prior of a small grid, cell by cell."""

from __future__ import annotations

import numpy as np
import pytest
from orograph.layers import UNKNOWN_GRADIENT, UNKNOWN_HEIGHT
from orograph.messages import UPDATE
from orograph.registers import unpack
from orograph.scenario import Scenario
from orograph.scene.buildings import footprint_polygon
from orograph.scene.prior import (
    believed_buildings,
    believed_terrain,
    building_cover,
    given_layers,
    prior_records,
)  # fmt: skip
from orograph.scene.terrain import ground_height_m
from shapely import Point


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
    told = {"terrain": {"height_m": 1.0}, "buildings": buildings, "prior": prior}
    roofs = np.zeros((4, 6), bool)
    roofs[0, 0] = roofs[2, 3] = roofs[2, 4] = True
    one, two = (prior_records(scenario(rules=rules, **told)).reshape(4, 6) for rules in ("paper", "surface"))
    np.testing.assert_array_equal(one["height"], np.where(roofs, 9000, 1000))
    for name in ("gradient_x", "gradient_y"):
        np.testing.assert_array_equal(one[name], np.where(roofs, UNKNOWN_GRADIENT, 0))
    assert not (one["confidence_top"].any() or one["wall_share"].any() or one["free_share"].any())
    for records in (one, two):
        np.testing.assert_array_equal(records["occupation"], np.where(roofs, 254, 0))
        assert set(records["confidence"].reshape(-1)) == {20}
    assert set(two["height"].reshape(-1)) == {1000} and not two["gradient_x"].any()
    np.testing.assert_array_equal(two["height_top"], np.where(roofs, 9000, UNKNOWN_HEIGHT))
    np.testing.assert_array_equal(two["confidence_top"], np.where(roofs, 20, 0))
    np.testing.assert_array_equal(two["wall_share"], np.where(roofs, 200, 0))
    np.testing.assert_array_equal(two["free_share"], np.where(roofs, 0, 200))


def test_overlaps_count_once_and_what_lies_outside_not_at_all():
    square = [[20, 10], [22, 10], [22, 14], [20, 14]]
    outside = [[25, 15], [60, 15], [60, 80], [25, 80]]
    world = scenario(buildings=[{"footprint": corners, "height_m": 5.0} for corners in (square, square, outside)])
    cover = building_cover([footprint_polygon(b) for b in world.buildings], world.grid.grid)
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


HOUSES = [
    {"footprint": [[x, y], [x + 20, y], [x + 20, y + 15], [x, y + 15]], "height_m": 6.0}
    for x in range(20, 460, 50) for y in range(20, 460, 50)
]  # fmt: skip


def town(seed: int = 1, **prior: float) -> Scenario:
    grid = {"cell_m": 5.0, "rows": 100, "cols": 100}
    return scenario(seed=seed, grid=grid, buildings=HOUSES, prior=prior, terrain={"height_m": 3.0, "slope_x": 0.01})


def test_a_prior_without_faults_is_the_true_scene():
    world = town()
    assert believed_terrain(world) == world.terrain
    assert believed_buildings(world) == [footprint_polygon(b) for b in world.buildings]


def test_ground_error_is_smooth_of_the_size_asked_for_and_of_the_seed():
    x, y = np.meshgrid(np.arange(0, 500, 5.0), np.arange(0, 500, 5.0))
    errors = []
    for seed in (1, 2, 3):
        wrong, true = town(seed, ground_error_m=0.4), town(seed)
        errors.append(ground_height_m(believed_terrain(wrong), x, y) - ground_height_m(true.terrain, x, y))
        assert np.sqrt(np.mean(errors[-1] ** 2)) == pytest.approx(0.4, rel=0.35)
        assert np.abs(np.diff(errors[-1], axis=1)).max() < 0.5  # over 5 m
    assert np.abs(errors[0] - errors[1]).max() > 0.4
    again = ground_height_m(believed_terrain(town(1, ground_error_m=0.4)), x, y)
    np.testing.assert_array_equal(again, errors[0] + ground_height_m(town().terrain, x, y))
    records = prior_records(town(1, ground_error_m=0.4, missing=1.0)).reshape(100, 100)
    at = x[::20, ::20] + 2.5, y[::20, ::20] + 2.5
    believed_m = ground_height_m(believed_terrain(town(1, ground_error_m=0.4)), *at)
    np.testing.assert_allclose(records["height"][::20, ::20] / 1e3, believed_m, atol=6e-4)


def test_buildings_go_missing_are_misplaced_and_invented():
    true = [footprint_polygon(b) for b in town().buildings]
    assert not believed_buildings(town(missing=1.0))
    assert 0.6 * len(true) < len(believed_buildings(town(missing=0.2))) < 0.95 * len(true)
    shifts = [(b.centroid.x - a.centroid.x, b.centroid.y - a.centroid.y)
              for a, b in zip(true, believed_buildings(town(shift_m=2.0)), strict=True)]  # fmt: skip
    assert np.std(shifts) == pytest.approx(2.0, rel=0.3)
    invented = believed_buildings(town(extra=0.1))[len(true) :]
    assert len(invented) == round(0.1 * len(true))
    assert not any(a.intersects(b) for a in invented for b in true)
    assert all(a.distance(Point(2, 18)) > 4.9 for a in invented)  # the only place that this scenario names


def test_without_confidence_nothing_is_known():
    world = town(confidence=0)
    known = unpack(prior_records(world), world.grid.grid)
    np.testing.assert_array_equal(prior_records(world)["cell"], np.arange(10_000))
    assert not known.known.any() and np.isnan(known.height).all() and np.isnan(known.occupation).all()
