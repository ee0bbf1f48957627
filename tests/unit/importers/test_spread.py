"""Places far apart by road, by hand and by brute force."""

import itertools

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from orograph.importers.spread import spread


def test_places_on_a_line_by_hand() -> None:
    x = np.array([0.0, 1.0, 5.0, 9.0, 10.0])
    assert spread(lambda i, _: np.abs(x - x[i]), 3, first=0) == ([0, 4, 2], 15.0)
    assert spread(lambda i, _: np.zeros(3), 3, first=1) == ([1], 0.0)


@given(st.lists(st.tuples(st.integers(0, 99), st.integers(0, 99)), min_size=4, max_size=9, unique=True))
def test_no_choice_of_as_many_is_twice_as_far_apart(places: list[tuple[int, int]]) -> None:
    xy = np.array(places, float)
    distance_m = np.hypot(*(xy[:, None] - xy).transpose(2, 0, 1))

    def within(place: int, limit_m: float) -> np.ndarray:
        return np.where(distance_m[place] <= limit_m, distance_m[place], 1e6)

    chosen, _ = spread(within, 4, first=0)
    assert chosen == spread(lambda i, _: distance_m[i], 4, first=0)[0]
    apart = min(distance_m[a, b] for a, b in itertools.combinations(chosen, 2))
    best = max(
        min(distance_m[a, b] for a, b in itertools.combinations((0, *others), 2))
        for others in itertools.combinations(range(1, len(places)), 3)
    )
    assert apart >= best / 2 - 1e-9
