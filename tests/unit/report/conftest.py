from __future__ import annotations

from dataclasses import replace
from typing import Any

import pytest
from made_up.run import city, made_up
from orograph.report.parts import RunParts
from orograph.scenario import Scenario


@pytest.fixture(scope="session")
def city_scenario() -> Scenario:
    """Two robots in a city of nine blocks."""
    return city()


@pytest.fixture(scope="session")
def city_run() -> RunParts:
    """A made-up run of two robots; do not write to it."""
    return made_up(city())


@pytest.fixture
def without(city_run: RunParts) -> Any:
    """The same run with some nodes' artifacts gone."""

    def cut(*names: str) -> RunParts:
        return replace(city_run, nodes={k: v for k, v in city_run.nodes.items() if k not in names})

    return cut
