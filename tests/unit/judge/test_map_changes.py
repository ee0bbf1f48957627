"""When something was found and when it was gone."""

from __future__ import annotations

import numpy as np
import pytest
from orograph.judge.map_changes import time_to_clear_s, time_to_find_s

STAMPS_S = np.arange(0.0, 10.0)


@pytest.mark.parametrize(
    ("shown", "found_s", "cleared_s"),
    [
        ([], None, 0.0),
        ([1], None, 0.0),  # before the event
        ([4], 0.0, 1.0),
        ([6, 7], 2.0, 4.0),
        ([4, 8], 0.0, 5.0),  # it came back: gone only after that
        ([4, 5, 6, 7, 8, 9], 0.0, None),
        ([9], 5.0, None),
    ],
)
def test_times(shown: list[int], found_s: float | None, cleared_s: float | None):
    mask = np.isin(np.arange(10), shown)
    assert time_to_find_s(STAMPS_S, mask, 4.0) == found_s
    assert time_to_clear_s(STAMPS_S, mask, 4.0) == cleared_s


def test_nothing_was_looked_at_since():
    assert time_to_find_s(STAMPS_S, np.ones(10, np.bool_), 20.0) is None
    assert time_to_clear_s(STAMPS_S, np.zeros(10, np.bool_), 20.0) is None
