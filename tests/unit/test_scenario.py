"""A scenario's bounds are the messages': what is accepted can be carried, and one more is refused in words."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from orograph import messages, scenario
from orograph.comms import wire
from orograph.geometry import rotation
from orograph.messages import POSE, Bodies, Digest, Mission, OccupancyGrid, RobotStatus, Scan
from orograph.scenario import Scenario
from orograph.world.navigation_sensors import Motion, NavigationSensors
from pydantic import ValidationError

LOOP = [(1, 1), (2, 1), (2, 2)]
AT_BOUNDS: dict[str, Any] = {
    "name": "vast",
    "title": "Everything at its bound",
    "grid": {"rows": 2000, "cols": 2000, "cell_m": 5},
    "hrm": {"cells": 2000, "per_glrm_cell": 10},
    "laser": {"rings": 256, "columns": 4096},
    "robots": 100,
    "starts": [{"x_m": 3 + i, "y_m": 3} for i in range(100)],
    "vehicles": [{"loop": LOOP}] * 1900,
    "base_station_m": [1, 1],
    "patrol": [[5, 5]] * 2000,
}


def changed(path: str, value: Any) -> dict[str, Any]:
    """The fields at their bounds with one of them changed: `grid.rows`."""
    head, _, rest = path.partition(".")
    return {**AT_BOUNDS, head: {**AT_BOUNDS.get(head, {}), rest: value} if rest else value}


def test_messages_of_a_scenario_at_its_bounds_can_be_carried() -> None:
    vast = Scenario.model_validate(AT_BOUNDS)
    shape, side, laser = vast.grid.grid.shape, vast.hrm.cells, vast.laser
    bodies = len(vast.robot_ids) + len(vast.vehicles)
    tiles = math.ceil(shape[0] / 20) * math.ceil(shape[1] / 20)
    waypoints = np.arange(len(vast.patrol), dtype="<u2")
    for message in (
        OccupancyGrid(0, 0.0, 0.0, vast.grid.cell_m, True, np.zeros(shape, "u1")),
        OccupancyGrid(0, 0.0, 0.0, vast.grid.cell_m / vast.hrm.per_glrm_cell, False, np.zeros((side, side), "u1")),
        Scan(0, np.zeros((laser.rings, laser.columns), "<u2")),
        Bodies(0, np.zeros(bodies, POSE)),
        Digest(1, 1, np.zeros((tiles, 16), "u1")),
        Mission(1, waypoints, False),
        RobotStatus(0, 1, waypoints, waypoints, "idle", 0.0, 0.0),
    ):
        assert len(wire.encode(message)) <= messages.MESSAGE_MAX_BYTES


@pytest.mark.parametrize(
    ("path", "value", "words"),
    [
        ("grid.rows", 2001, "less than or equal to 2000"),
        ("grid.cols", 2001, "less than or equal to 2000"),
        ("grid.cell_m", 1000.1, "less than or equal to 1000"),
        ("hrm.cells", 2010, "less than or equal to 2000"),
        ("laser.rings", 257, "less than or equal to 256"),
        ("laser.columns", 4097, "less than or equal to 4096"),
        ("robots", 101, "less than or equal to 100"),
        ("starts", [{"x_m": 3, "y_m": 3}] * 101, "at most 100 items"),
        ("vehicles", [{"loop": LOOP}] * 1901, "at most 1900 items"),
        ("patrol", [[5, 5]] * 2001, "at most 2000 items"),
        ("robot", {"speed_max_mps": 20.1}, "less than or equal to 20"),
        ("robot", {"yaw_rate_max_radps": 20.1}, "less than or equal to 20"),
        ("grid.cell_m", 0.009, "makes cells of 0.0009 m, at least 0.001 m are needed"),
    ],
)
def test_one_more_is_refused_in_words(path: str, value: Any, words: str) -> None:
    with pytest.raises(ValidationError, match=words):
        Scenario.model_validate(changed(path, value))


def test_a_scenario_too_long_to_be_told_is_refused_in_words(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(scenario, "JSON_MAX_BYTES", 100_000)
    with pytest.raises(ValidationError, match="bytes as JSON, at most 100000 can be told"):
        Scenario.model_validate(AT_BOUNDS)


def test_the_worst_sensors_still_say_what_can_be_carried() -> None:
    noise = dict.fromkeys(("gps_single_m", "attitude_deg", "heading_deg", "yaw_rate_radps", "odometry_mps"), 1e300)
    sensors = NavigationSensors(Scenario.model_validate(changed("navigation_sensors", noise)), 1, "robot_001")
    far = Motion(np.array([1e9, -1e9, -1e9]), rotation(0.1, -0.2, 3.1), 1e5, 1e5)
    for frame in range(20):
        wire.encode(sensors.read(far, 1, frame, frame))
