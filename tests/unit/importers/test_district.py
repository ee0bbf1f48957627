"""Degrees, heights and footprints by hand."""

import math

import numpy as np
import pytest
import shapely
from orograph.importers.district import clear_of, houses, local_crs, street_points, to_metres

AREA = shapely.box(0, 0, 200, 200)


def test_a_degree_by_the_books() -> None:
    # Published lengths of a degree on WGS 84: 111 319.5 m east at the equator, 55 800 / 111 412 m at 60 degrees.
    places = to_metres([shapely.Point(0.01, 0.0)], local_crs((0.0, 0.0, 0.1, 0.1)))
    assert places[0].x == pytest.approx(1113.195, abs=0.01)
    north, east = to_metres([shapely.Point(10, 60.005), shapely.Point(10.01, 60)], local_crs((10.0, 60.0, 10.1, 60.1)))
    assert (east.x, north.y) == (pytest.approx(558.0, abs=0.02), pytest.approx(557.06, abs=0.02))


def test_courtyards_stay_open_where_they_are_large_and_are_filled_where_small() -> None:
    outer, large, small = shapely.box(10, 10, 90, 60), shapely.box(30, 25, 50, 45), shapely.box(70, 30, 75, 35)
    pieces = houses([(outer - large - small, {"building": "yes"})], AREA).walls
    assert all(not piece.interiors for piece, _ in pieces)
    union = shapely.union_all([piece for piece, _ in pieces])
    assert union.area == pytest.approx(80 * 50 - 20 * 20)
    assert not union.contains(large.centroid) and union.contains(small.centroid)


def test_tiny_and_outlying_parts_are_dropped() -> None:
    shapes = [shapely.box(5, 5, 8, 8), shapely.box(190, 190, 260, 260), shapely.box(300, 300, 400, 400)]
    found = houses([(s, {"building": "yes"}) for s in shapes], AREA)
    assert [piece.bounds for piece, _ in found.walls] == [(190, 190, 200, 200)]
    assert found.notes == {"left out: smaller than 12 m2": 1, "height guessed by type": 1}


def test_what_does_not_stand_on_the_ground_is_left_out_and_counted() -> None:
    shape = shapely.box(10, 10, 30, 30)
    tags = [{"building": "no"}, {"building": "yes", "location": "underground"}, {"building": "roof"},
            {"building": "yes", "min_height": "4"}, {"building": "yes", "height": "5"}]  # fmt: skip
    found = houses([(shape, t) for t in tags], AREA)
    assert [height for _, height in found.walls] == [5.0]
    assert found.notes == {
        "left out: torn down or not yet built": 1, "left out: underground": 1, "left out: raised, open underneath": 2,
    }  # fmt: skip


def test_a_crossed_outline_is_mended_and_said() -> None:
    crossed = shapely.Polygon([(10, 10), (40, 30), (40, 10), (10, 30)])
    found = houses([(crossed, {"building": "yes", "height": "8"})], AREA)
    assert sum(piece.area for piece, _ in found.walls) == pytest.approx(300.0)
    assert found.notes == {"invalid, crossed outline mended": 1}


def test_points_lie_on_streets_with_their_heading_and_keep_clear() -> None:
    street = shapely.LineString([(10, 50), (110, 50)])
    points = street_points([(street, {"highway": "residential"})], AREA, 10.0)
    assert np.allclose(points[:, 0], np.arange(15, 115, 10)) and np.allclose(points[:, 1:], [50, 0])
    assert not len(street_points([(street, {"highway": "steps"})], AREA, 10.0))
    assert not len(street_points([(street, {"highway": "residential", "layer": "-1"})], AREA, 10.0))
    kept = clear_of(points, [(shapely.box(0, 53, 40, 80), 10.0)], 5.0)
    assert kept[:, 0].min() == pytest.approx(45.0)
    north = street_points([(shapely.LineString([(5, 5), (5, 95)]), {"highway": "service"})], AREA, 30.0)
    assert np.allclose(north[:, 2], math.pi / 2)
