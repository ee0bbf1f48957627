"""What the units' tests share: a made-up run, small scenarios, a flat world and poses in it."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from made_up.run import city, made_up
from orograph.geometry import quaternion, rotation
from orograph.judge import reference
from orograph.judge.reference import Reference
from orograph.messages import POSE, Packed
from orograph.scenario import GridSpec, Scenario, Start
from orograph.storage.parts import RunParts

QUIET = {"rings": 8, "columns": 36, "noise_m": 0.0, "dropout": 0.0}


@pytest.fixture
def flat_world() -> Callable[..., Scenario]:
    """flat_world(laser={...}, buildings=[...]) -> a 200 m square at height 0 with a quiet laser, three starts."""

    def build(laser=(), **fields) -> Scenario:
        return Scenario.model_validate(
            {
                "name": "flat", "title": "flat", "robots": 3, "base_station_m": [15, 15], "patrol": [[15, 15]],
                "starts": [{"x_m": 15 + 5 * i, "y_m": 15} for i in range(3)], "grid": {"rows": 40, "cols": 40},
                "laser": {**QUIET, **dict(laser)}, **fields,
            }
        )  # fmt: skip

    return build


@pytest.fixture
def poses_at() -> Callable[..., Packed]:
    """poses_at((x, y, z, yaw), None, ...) -> POSE records; None is an absent body."""

    def build(*bodies) -> Packed:
        poses = np.zeros(len(bodies), POSE)
        poses["quaternion_wxyz"][:, 0] = 1
        for pose, body in zip(poses, bodies, strict=True):
            if body is not None:
                pose["position_m"], pose["present"] = body[:3], 1
                pose["quaternion_wxyz"] = quaternion(rotation(0, 0, body[3]))
        return poses

    return build


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


@pytest.fixture(scope="session")
def city_scenario() -> Scenario:
    """Two robots in a city of nine blocks."""
    return city()


@pytest.fixture(scope="session")
def city_run() -> RunParts:
    """A made-up run of two robots; do not write to it."""
    return made_up(city())


@pytest.fixture(scope="session")
def built(city_scenario: Scenario) -> Reference:
    """The reference of the city; do not write to it."""
    return reference.build(city_scenario)


@pytest.fixture
def without(city_run: RunParts) -> Any:
    """The same run with some nodes' artifacts gone."""

    def cut(*names: str) -> RunParts:
        return replace(city_run, nodes={k: v for k, v in city_run.nodes.items() if k not in names})

    return cut


@pytest.fixture
def fine_switching() -> Iterator[None]:
    """Threads take turns as often as they can, so that a race shows soon."""
    interval_s = sys.getswitchinterval()
    sys.setswitchinterval(1e-6)
    yield
    sys.setswitchinterval(interval_s)
