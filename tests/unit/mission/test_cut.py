"""One tour cut into stretches, against every cut, every assignment of robots and both directions."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from orograph.mission.cut import WITHIN_M, cut
from orograph.mission.split import longest_m


def plane(seed: int, robots: int, stops: int) -> np.ndarray:
    places = np.random.default_rng(seed).uniform(0, 500, (robots + stops, 2))
    return np.linalg.norm(places[:, None] - places[None], axis=2)


def shortest_longest_m(distance_m: np.ndarray, robots: int, tour: list[int]) -> float:
    """By hand: stretches between all bars, driven by all permutations of robots from either end."""
    best = float("inf")
    for bars in itertools.combinations_with_replacement(range(len(tour) + 1), robots - 1):
        parts = [tour[a:b] for a, b in itertools.pairwise((0, *bars, len(tour)))]
        for drivers in itertools.permutations(range(robots)):
            longest = 0.0
            for robot, part in zip(drivers, parts, strict=True):
                ways = [[robot, *(robots + w for w in way)] for way in (part, part[::-1])]
                longest = max(longest, min(sum(distance_m[a, b] for a, b in itertools.pairwise(w)) for w in ways))
            best = min(best, longest)
    return best


@settings(max_examples=40, deadline=None)
@given(st.integers(0, 2**32 - 1), st.integers(1, 3), st.integers(0, 6))
def test_no_cut_of_the_tour_has_a_shorter_longest_stretch(seed: int, robots: int, stops: int) -> None:
    distance_m, tour = plane(seed, robots, stops), np.random.default_rng(seed).permutation(stops).tolist()
    tours = cut(distance_m, robots, tour)
    assert sorted(w for t in tours for w in t) == list(range(stops))
    assert longest_m(robots, distance_m, tours) <= shortest_longest_m(distance_m, robots, tour) + WITHIN_M


@pytest.mark.parametrize(("robots", "longest"), [(2, 515), (3, 345), (5, 210), (10, 110)])
def test_a_long_street_is_shared_evenly_by_robots_spread_along_it(robots: int, longest: float) -> None:
    along_m = np.array([1030 * r / robots for r in range(robots)] + [20.0 * k for k in range(52)])
    distance_m = np.abs(along_m[:, None] - along_m[None])
    assert longest_m(robots, distance_m, cut(distance_m, robots, range(52))) <= longest
