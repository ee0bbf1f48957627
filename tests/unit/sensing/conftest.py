"""A flat world for the laser's tests, and poses in it."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from orograph.geometry import quaternion, rotation
from orograph.messages import POSE, Packed
from orograph.scenario import Scenario

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
