"""Small scenarios for the world's tests."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pytest
from orograph.scenario import GridSpec, Scenario, Start


def _scenario(**parts: Any) -> Scenario:
    """A flat, empty square of 100 m with one robot in the middle, heading east, unless the parts say otherwise."""
    chosen: dict[str, Any] = {
        "name": "square",
        "title": "A square",
        "grid": GridSpec(rows=20, cols=20),
        "starts": (Start(x_m=50, y_m=50),),
        "robots": 1,
        "base_station_m": (1, 1),
        "patrol": ((5, 5),),
    }
    return Scenario(**(chosen | parts))


@pytest.fixture(scope="session")
def scenario_of() -> Callable[..., Scenario]:
    return _scenario
