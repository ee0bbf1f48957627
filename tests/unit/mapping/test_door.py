"""Whatever readers give is mapped or refused in words; any clock, any place."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from orograph.mapping.door import ScanClock, checked_points, checked_position, checked_ranges, positive

CLOUD = np.arange(60.0).reshape(20, 3)


@pytest.mark.parametrize(
    "given_form",
    [
        CLOUD,
        CLOUD.tolist(),
        np.c_[CLOUD, np.ones(20)],
        CLOUD.reshape(4, 5, 3),
        np.asfortranarray(CLOUD),
        CLOUD.astype(int),
    ],
    ids=["(n, 3)", "list", "(n, 4)", "(h, w, 3)", "columns first", "whole numbers"],
)
def test_forms_of_clouds(given_form: object) -> None:
    np.testing.assert_array_equal(checked_points(given_form), CLOUD)


@pytest.mark.parametrize(
    ("bad", "words"),
    [
        (np.zeros((5, 2)), "found (5, 2)"),
        (np.zeros(5), "found (5,)"),
        (np.array([["a", "b", "c"]]), "pick the fields"),
        (np.zeros(3, [("x", "f4")]), "pick the fields"),
        (np.full((2, 3), 5e6, np.float32), "float32 holds steps of 0.5 m"),
    ],
)
def test_clouds_that_cannot_be_are_refused_in_words(bad: np.ndarray, words: str) -> None:
    with pytest.raises(ValueError, match="points: ") as told:
        checked_points(bad)
    assert words in str(told.value)


def test_float32_near_an_origin_stays_float32_and_float64_holds_any_place() -> None:
    assert checked_points(CLOUD.astype(np.float32)).dtype == np.float32
    np.testing.assert_array_equal(checked_points(CLOUD + 5e6), CLOUD + 5e6)
    assert checked_points(np.array([[np.nan, np.inf, 1.0]], np.float32)).shape == (1, 3)


def test_ranges_and_positions() -> None:
    for form in (np.ones((4, 1)), np.ones((2, 2)), [1, 1, 1, 1]):
        np.testing.assert_array_equal(checked_ranges(form, 4), np.ones(4))
    with pytest.raises(ValueError, match=r"ranges_m: expected one number for each of 4 points \[m\], found \(3,\)"):
        checked_ranges(np.ones(3), 4)
    assert checked_position(np.array([1.0, 2.0, 3.0])) == (1.0, 2.0)
    for bad in ([1.0], [np.nan, 0.0], [0.0, np.inf]):
        with pytest.raises(ValueError, match="position_xy_m"):
            checked_position(bad)
    for number in (0.0, -1.0, np.nan, np.inf):
        with pytest.raises(ValueError, match="range_max_m: expected a finite number above 0"):
            positive("range_max_m", number)


@pytest.mark.parametrize("first_ns", [1_700_000_000_000_000_000, -5_000_000_000, 2**62])
def test_another_clock_counts_from_its_first_stamp(first_ns: int) -> None:
    clock = ScanClock()
    assert [clock.tick(first_ns + k * 400_000_000) for k in range(3)] == [0, 400, 800]


@given(st.lists(st.integers(0, 10**13), min_size=1, max_size=20))
def test_simulation_time_is_its_own_tick(stamps_ns: list[int]) -> None:
    clock = ScanClock()
    assert [clock.tick(stamp) for stamp in sorted(stamps_ns)] == [stamp // 1_000_000 for stamp in sorted(stamps_ns)]


def test_a_clock_that_was_set_back_goes_on_and_is_counted() -> None:
    clock = ScanClock()
    ticks = [clock.tick(s * 1_000_000_000) for s in (0, 100, 200, 0, 1, 2)]
    assert ticks == [0, 100_000, 200_000, 400_000, 401_000, 402_000]
    assert clock.restarts == 1


def test_a_stamp_that_comes_late_keeps_its_time() -> None:
    clock = ScanClock()
    assert [clock.tick(s * 1_000_000) for s in (5_000, 4_500, 5_100)] == [5_000, 4_500, 5_100]
    assert clock.restarts == 0


def test_more_than_49_days_is_refused_in_words() -> None:
    clock = ScanClock()
    clock.tick(0)
    with pytest.raises(ValueError, match="49 days"):
        clock.tick(2**32 * 1_000_000)
