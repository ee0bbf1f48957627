"""The time machine: at any time, reached by any way, the map is the one that the changes up to then make."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from orograph.console.film import MapCourse, row_at
from orograph.messages import UPDATE
from orograph.nodes.cell_history import CHANGE

CELLS = 8
CHANGES = st.lists(st.tuples(st.integers(0, 9), st.integers(0, CELLS - 1), st.integers(1, 99)), max_size=30)


def prior() -> np.ndarray:
    records = np.zeros(CELLS, UPDATE)
    records["cell"], records["height"] = np.arange(CELLS), -1
    return records


@given(CHANGES, st.lists(st.integers(-1, 10), min_size=1, max_size=6))
def test_any_way_through_time_leads_to_the_same_map(course: list[tuple[int, int, int]], visits: list[int]) -> None:
    rows = np.zeros(len(course), CHANGE)
    for row, (stamp, cell, height) in zip(rows, sorted(course, key=lambda c: c[0]), strict=True):
        row["stamp_ns"], row["cell"], row["height"] = stamp, cell, height
    map_course = MapCourse(prior())
    for visit in visits:
        map_course.seek(rows, visit)
        height, changed = [-1] * CELLS, [-1] * CELLS
        for row in rows[rows["stamp_ns"] <= visit]:
            height[row["cell"]], changed[row["cell"]] = int(row["height"]), int(row["stamp_ns"])
        assert map_course.cells["height"].tolist() == height
        assert map_course.changed_ns.tolist() == changed


def test_a_row_holds_from_its_stamp_on() -> None:
    rows = np.array([[10.0, 1.0], [20.0, 2.0]])
    assert [None if (row := row_at(rows, t)) is None else row[1] for t in (9, 10, 19, 20, 99)] == [None, 1, 1, 2, 2]
