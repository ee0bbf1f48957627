"""What is kept of the map's course gives the map back at each time; thinned out, still the last one."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from orograph.messages import CELL
from orograph.nodes.cell_history import CHANGE, CellHistory

CELLS = 12
COURSE = st.lists(st.dictionaries(st.integers(0, CELLS - 1), st.integers(-50, 50), max_size=5), max_size=20)


def kept(course: list[dict[int, int]], bytes_max: int) -> np.ndarray:
    history = CellHistory(bytes_max)
    for second, heights in enumerate(course):
        cells = np.zeros(len(heights), CELL)
        cells["cell"], cells["height"] = list(heights), list(heights.values())
        history.append(second, cells)
    return history.rows()


def replayed(rows: np.ndarray, until: int) -> dict[int, int]:
    return {int(r["cell"]): int(r["height"]) for r in rows if r["stamp_ns"] <= until}


@given(COURSE)
def test_every_moment_is_given_back(course: list[dict[int, int]]) -> None:
    rows, truth = kept(course, 10**6), dict[int, int]()
    for second, heights in enumerate(course):
        truth |= heights
        assert replayed(rows, second) == truth


@given(COURSE, st.integers(1, 10))
def test_thinned_out_it_ends_as_the_map_did_within_its_bound(course: list[dict[int, int]], rows_max: int) -> None:
    rows, truth = kept(course, rows_max * CHANGE.itemsize), dict[int, int]()
    for heights in course:
        truth |= heights
    assert replayed(rows, len(course)) == truth
    assert len(rows) <= max(rows_max, CELLS)
    assert (np.diff(rows["stamp_ns"]) >= 0).all()
