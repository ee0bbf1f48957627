"""Degrees, heights and footprints by hand."""

import math

import numpy as np
import pytest
import shapely
from orograph.importers.district import clear_of, footprints, height_m, metres_per_degree, street_points

AREA = shapely.box(0, 0, 200, 200)


def test_a_degree_by_the_books() -> None:
    # Published lengths of a degree on WGS 84: 111 319.5 / 110 574.3 m at the equator, 55 800 / 111 412 m at 60 degrees.
    assert metres_per_degree(0.0) == pytest.approx((111_319.5, 110_574.3), abs=0.1)
    assert metres_per_degree(60.0) == pytest.approx((55_800.0, 111_412.0), abs=1.0)


@pytest.mark.parametrize(
    ("tags", "height"),
    [
        ({"height": "12.5"}, 12.5), ({"height": "12,5 m"}, 12.5), ({"height": "9000"}, 300.0),
        ({"building:levels": "4"}, 13.8), ({"height": "tall", "building:levels": "1"}, 4.2),
        ({"height": "0"}, 10.0), ({}, 10.0),
    ],
)  # fmt: skip
def test_heights(tags: dict[str, str], height: float) -> None:
    assert height_m({"building": "yes", **tags}) == height


def test_a_type_has_its_own_default() -> None:
    assert height_m({"building": "garage"}) == 3.0


def test_courtyards_stay_open_where_they_are_large_and_are_filled_where_small() -> None:
    outer, large, small = shapely.box(10, 10, 90, 60), shapely.box(30, 25, 50, 45), shapely.box(70, 30, 75, 35)
    pieces = footprints([(outer - large - small, {"building": "yes"})], AREA)
    assert all(not piece.interiors for piece, _ in pieces)
    union = shapely.union_all([piece for piece, _ in pieces])
    assert union.area == pytest.approx(80 * 50 - 20 * 20)
    assert not union.contains(large.centroid) and union.contains(small.centroid)


def test_tiny_and_outlying_parts_are_dropped() -> None:
    shapes = [shapely.box(5, 5, 8, 8), shapely.box(190, 190, 260, 260), shapely.box(300, 300, 400, 400)]
    (piece, _), = footprints([(s, {"building": "yes"}) for s in shapes], AREA)  # fmt: skip
    assert piece.bounds == (190, 190, 200, 200)


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
