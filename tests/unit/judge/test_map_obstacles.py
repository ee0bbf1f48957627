"""What counts as seen, missed and false, by hand."""

from __future__ import annotations

import math

import numpy as np
import pytest
from orograph.geometry import rotation
from orograph.grid import Grid
from orograph.judge.map_obstacles import (
    SEEN_POINTS,
    SIGHTING,
    Body,
    ghosts,
    obstacle_figures,
    remains,
    shows,
    sightings,
)

GRID = Grid((-20.0, -20.0), 0.5, (160, 160))
CAR = Body(np.array([6.0, 2.0, 1.0]), np.array([4.0, 2.0, 1.5]), rotation(0.0, 0.0, math.pi / 2))
"""Turned: it covers x 5-7 m, y 0-4 m, z 1-2.5 m."""
HERE = np.zeros(3)
ON_IT = np.tile([6.0, 0.0, 2.0], (SEEN_POINTS, 1))


def blocked(*places: tuple[float, float]) -> np.ndarray:
    out = np.zeros(GRID.shape, np.bool_)
    for x, y in places:
        out[GRID.row_col(x, y)] = True
    return out


def test_points_on_a_body_and_not_those_at_its_foot_or_over_it():
    points = np.array([[5.0, 2, 2], [7.05, 2, 2], [6, -0.09, 1.3], [6, 2, 2.55],  # on it, to the noise
                       [7.2, 2, 2], [6, 4.2, 2], [6, 2, 1.1], [6, 2, 2.7], [60, 2, 2]])  # fmt: skip
    assert [CAR.points_on(p[None]) for p in points] == [1, 1, 1, 1, 0, 0, 0, 0, 0]


@pytest.mark.parametrize(
    ("cells", "seen"),
    [
        ([], False),
        ([(6.2, 2.2)], False),  # one cell alone
        ([(6.2, 2.2), (6.7, 2.2)], True),
        ([(6.2, 2.2), (6.2, 2.7)], True),
        ([(6.2, 2.2), (6.7, 2.7)], True),
        ([(6.7, 2.2), (6.2, 2.7)], True),
        ([(5.2, 0.2), (6.7, 3.7)], False),  # two, but apart
        ([(8.2, 2.2), (8.7, 2.2)], False),  # beside it
    ],
)
def test_two_touching_cells_on_it_show_a_body(cells, seen):
    assert shows(blocked(*cells), GRID, CAR) is seen
    missed = sightings(blocked(*cells), GRID, HERE, ON_IT, [CAR])
    assert missed["missed"].tolist() == [not seen]
    assert missed["distance_m"][0] == pytest.approx(math.hypot(6, 2))


def test_a_body_far_away_or_hardly_hit_need_not_be_seen():
    nothing = blocked()
    assert not len(sightings(nothing, GRID, HERE, ON_IT[1:], [CAR]))
    assert not len(sightings(nothing, GRID, np.array([-20.0, 2.0, 0.0]), ON_IT, [CAR]))


def test_what_remains_where_a_body_was():
    assert remains(blocked((6.2, 2.2)), GRID, CAR)
    assert remains(blocked((7.6, 2.2)), GRID, CAR)  # within the rim
    assert not remains(blocked((8.2, 2.2), (6.2, 5.2)), GRID, CAR)


def test_ghosts_are_near_in_the_clear_and_on_nobody():
    clear = ~blocked((1.2, 1.2))
    false = blocked((1.2, 1.2), (2.2, 2.2), (6.2, 2.2), (-19.2, -8.2), (-10.2, 0.2))
    assert ghosts(false, GRID, HERE, clear, [CAR]) == 2  # (2.2, 2.2) and (-10.2, 0.2)
    assert ghosts(false, GRID, HERE, clear, []) == 3
    assert ghosts(false | blocked((3.2, 3.2)), GRID, HERE, clear, [CAR]) == 3
    assert ghosts(blocked(), GRID, np.array([-40.0, 0, 0]), clear, []) == 0


def test_figures_by_distance():
    seen = np.array([(2.0, False), (4.9, True), (5.0, True), (24.0, False)], SIGHTING)
    figures = obstacle_figures(seen, np.array([0, 3, 0, 1]))
    assert (figures["missed_0_5_m"], figures["missed_5_10_m"], figures["missed_15_25_m"]) == (0.5, 1.0, 0.0)
    assert math.isnan(figures["missed_10_15_m"]) and figures["sightings_10_15_m"] == 0
    assert (figures["missed"], figures["sightings"], figures["ghosts_per_scan"]) == (0.5, 4, 1.0)
    worse = obstacle_figures(np.array([(2.0, True)] * 4, SIGHTING), np.array([0, 3, 9, 1]))
    assert worse["missed"] > figures["missed"] and worse["ghosts_per_scan"] > figures["ghosts_per_scan"]
