"""Vehicle loops: their length by hand, and that a vehicle never jumps or turns on the spot."""

from __future__ import annotations

import math

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from orograph.scenario import Scenario
from orograph.scene import build_scene
from orograph.scene.vehicles import CORNER_RADIUS_M, rounded_loop

SQUARE = ((0.0, 0.0), (100.0, 0.0), (100.0, 60.0), (0.0, 60.0))


LANE = ((0.0, 0.0), (100.0, 0.0), (100.0, 4.0), (0.0, 4.0))


def wrapped(angle_rad: float) -> float:
    return (angle_rad + math.pi) % (2 * math.pi) - math.pi


def test_length_of_a_rounded_rectangle():
    expected = 2 * (100 + 60) - 8 * CORNER_RADIUS_M + 2 * math.pi * CORNER_RADIUS_M
    # The arcs are polylines of 5 degrees: shorter by (5 deg)^2 / 24 = 0.03 %.
    assert rounded_loop(SQUARE).length_m == pytest.approx(expected, rel=5e-4)


def test_starts_where_the_first_corner_begins_to_turn_and_closes():
    loop = rounded_loop(SQUARE)
    assert loop.at(0.0) == pytest.approx((0.0, CORNER_RADIUS_M, -math.pi / 2))
    assert loop.at(loop.length_m * 3) == pytest.approx((0.0, CORNER_RADIUS_M, -math.pi / 2))


def test_middle_of_an_edge_is_on_the_edge():
    loop = rounded_loop(SQUARE)
    arc_m = math.pi / 2 * CORNER_RADIUS_M
    x, y, yaw = loop.at(arc_m + 45.0)
    assert (x, y, yaw) == pytest.approx((50.0, 0.0, 0.0), abs=0.02)


def test_short_edges_take_smaller_arcs():
    loop = rounded_loop(((0.0, 0.0), (4.0, 0.0), (4.0, 4.0), (0.0, 4.0)))
    assert loop.length_m == pytest.approx(2 * math.pi * 2.0, rel=1e-3), "a circle of half the edge"


@pytest.mark.parametrize("corners", [SQUARE, SQUARE[::-1], LANE, ((0.0, 0.0), (80.0, 5.0), (30.0, 50.0), (35.0, 20.0))])
@settings(deadline=None)
@given(start=st.floats(-500, 2000))
def test_moves_smoothly_with_its_nose_ahead(corners, start):
    loop, step_m = rounded_loop(corners), 0.2
    (x, y, yaw), (x2, y2, yaw2) = loop.at(start), loop.at(start + step_m)
    moved_m = math.hypot(x2 - x, y2 - y)
    assert moved_m <= step_m + 1e-9
    assert moved_m > 0.97 * step_m
    assert abs(wrapped(yaw2 - yaw)) < 0.2, "no turn on the spot"
    assert abs(wrapped(math.atan2(y2 - y, x2 - x) - yaw)) < 0.2, "no drift"


def test_coinciding_corners_are_named():
    scenario = {
        "name": "bad", "title": "bad", "robots": 1, "starts": [{"x_m": 50, "y_m": 50}], "base_station_m": [50, 50],
        "patrol": [[50, 50]], "terrain": {"slope_x": 0.1}, "vehicles": [{"loop": SQUARE}],
    }  # fmt: skip
    scene = build_scene(Scenario.model_validate(scenario))
    x, y, z, yaw = scene.vehicle_pose(0, 60.0)
    assert z == pytest.approx(0.1 * x)
    assert (y, yaw) == pytest.approx((0.0, 0.0), abs=1e-6)
    assert scene.vehicle_loop_length_m(0) == rounded_loop(SQUARE).length_m
    scenario["vehicles"] = [{"loop": SQUARE}, {"loop": [[0, 0], [0, 0], [10, 0]]}]
    with pytest.raises(ValueError, match=r"vehicles\[1\]: two following corners"):
        build_scene(Scenario.model_validate(scenario))
