"""Names, waypoints and times that suit any folder and any district."""

import re

import pytest
from hypothesis import given
from hypothesis import strategies as st
from orograph.importers.scenario import duration_s, scenario_name, waypoints_for

PERMITTED = re.compile(r"[a-z][a-z0-9-]{0,40}")


@pytest.mark.parametrize(
    ("folder", "name"),
    [
        ("my town", "my-town"), ("2024-town", "district-2024-town"), ("Zürich", "zurich"), ("東京", "district"),
        ("a" * 60, "a" * 40),
    ],
)  # fmt: skip
def test_names_of_folders(folder: str, name: str) -> None:
    assert scenario_name(folder) == name


@given(st.text(max_size=80))
def test_any_folder_gives_a_permitted_name(folder: str) -> None:
    assert PERMITTED.fullmatch(scenario_name(folder))


def test_a_larger_district_gets_more_waypoints_and_more_time() -> None:
    assert [waypoints_for(n, 8.0) for n in (10, 1000, 100_000)] == [20, 53, 300]
    # A net of 10 km, driven twice by two robots at 1.2 m/s: 8 334 s, more than a run may last; by ten robots 1 667 s.
    assert [duration_s(10_000, robots) for robots in (2, 10)] == [7200, 1800]
    assert duration_s(100, 3) == 900
