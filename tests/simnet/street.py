"""Where storms rage: a small flat street, and laser and navigator of a robot in a few lines."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from functools import lru_cache

import numpy as np
from orograph import keys
from orograph.geometry import ray_directions
from orograph.mapping import RobotMapper
from orograph.messages import RANGE_UNIT_M, Envelope, Frame, Mission, Pose, RobotStatus, Scan
from orograph.node import Note, Send
from orograph.protocol.limits import Limits
from orograph.rules import Rules
from orograph.scenario import Scenario
from orograph.scene.prior import given_layers, prior_records

SCENARIO = Scenario.model_validate(
    {
        "name": "storm", "title": "A street in a storm", "frame_ms": 200, "duration_max_s": 600,
        "grid": {"rows": 24, "cols": 9}, "hrm": {"cells": 20, "per_glrm_cell": 2},
        "laser": {"rings": 5, "columns": 24, "range_max_m": 20, "period_frames": 2,
                  "elevation_min_deg": -25, "elevation_max_deg": -2},
        "starts": [{"x_m": 22, "y_m": 20 + 20 * i} for i in range(4)], "base_station_m": [5, 5],
        "patrol": [[22, 30], [22, 90]], "prior": {"confidence": 4},
    }
)  # fmt: skip
"""216 cells, two tiles: small enough to be quick, large enough that tiles differ."""
SIZE = SCENARIO.grid.grid.size
RULES = Rules.of(SCENARIO.rules)
PRIOR = prior_records(SCENARIO)
SMALL = Limits(batch_cells=20, largest_change_share=5, part_cells=24, answers_per_step=3, parts_per_robot=2)
"""Cut down to this small map, so that answers come in parts and batches wait for room."""
DIRECTIONS = ray_directions(SCENARIO.laser)
GROUND_M = SCENARIO.laser.height_above_base_m / -DIRECTIONS[..., 2]
"""All rays look down."""
STATUS_FRAMES = 5
NOWHERE = np.zeros(0, "<u2")
WALLS = 0.05
"""Share of the rays that hit something that is not there the next time."""
NOISE = 0.01


class Driver:
    """What it sees depends on (seed, robot, frame) alone, so a run without faults sees the same.

    It scans until frame `scans_until`; from frame `done_at` on it says that the patrol is driven.
    """

    def __init__(self, scenario: Scenario, robot: str, scans_until: float, done_at: int) -> None:
        self.name, self._mapping = keys.node(keys.NAVIGATOR, robot), keys.node(keys.MAPPING, robot)
        self._scenario, self._number = scenario, keys.robot_number(robot)
        self._scans_until, self._done_at = scans_until, done_at
        self._patrol = np.arange(len(scenario.patrol), dtype="<u2")
        self._mission = 0

    def step(self, frame: Frame, inbox: Sequence[Envelope], send: Send, note: Note) -> None:
        """A scan every few frames; a robot of an even number learns its pose a frame later."""
        for envelope in inbox:
            if isinstance(envelope.message, Mission):
                self._mission = max(self._mission, envelope.message.number)
        if self._scans(frame.index):
            send(keys.SIM, self._mapping, self.scan(frame.index))
        late = 1 - self._number % 2
        if self._scans(frame.index - late):
            send(keys.SIM, self._mapping, self.pose(frame.index - late))
        if frame.index % STATUS_FRAMES == self._number:
            send(keys.RADIO, keys.ORCHESTRATOR, self._status(frame))

    def _scans(self, frame: int) -> bool:
        return 0 <= frame < self._scans_until and frame % self._scenario.laser.period_frames == 0

    def _status(self, frame: Frame) -> RobotStatus:
        done = frame.index >= self._done_at
        state, visited = ("done", self._patrol) if done else ("driving", NOWHERE)
        return RobotStatus(frame.stamp_ns, self._mission, visited, NOWHERE, state, *self._at_m(frame.index))

    def _at_m(self, frame: int) -> tuple[float, float]:
        x0, y0, x1, y1 = self._scenario.grid.grid.extent_m
        turn = 0.03 * frame + 2.1 * self._number + 0.37 * self._scenario.seed
        return (
            x0 + (0.5 + 0.3 * math.sin(2.2 * turn)) * (x1 - x0),
            y0 + (0.5 + 0.4 * math.cos(turn)) * (y1 - y0),
        )

    def pose(self, frame: int) -> Pose:
        x_m, y_m = self._at_m(frame)
        return Pose(frame * self._scenario.frame_ns, x_m, y_m, 0.0, 0.0, 0.0, 0.0, 0.1)

    def scan(self, frame: int) -> Scan:
        return Scan(frame * self._scenario.frame_ns, _ranges(self._scenario.seed, self._number, frame))

    def telemetry(self) -> Mapping[str, float]:
        return {}

    def artifacts(self) -> Mapping[str, np.ndarray]:
        return {}


@lru_cache(maxsize=2000)
def _ranges(seed: int, robot: int, frame: int) -> np.ndarray:
    """(rings, columns) in RANGE_UNIT_M that a level laser has of level ground, with noise and walls."""
    rng = np.random.default_rng([seed, 3, robot, frame])
    ranges_m = GROUND_M * (1 + NOISE * rng.standard_normal(GROUND_M.shape))
    ranges_m = np.where(rng.random(GROUND_M.shape) < WALLS, 0.7 * ranges_m, ranges_m)
    return np.where(ranges_m < SCENARIO.laser.range_max_m, ranges_m / RANGE_UNIT_M, 0).astype("<u2")


def street_of(seed: int, robots: int) -> Scenario:
    return SCENARIO.model_copy(update={"seed": seed, "robots": robots})


@lru_cache(maxsize=2000)
def mapped_alone(seed: int, robot: str, frames: int) -> np.ndarray:
    """A robot's registers (UPDATE) over the scans of so many frames, had nobody ever disturbed or answered it."""
    scenario = street_of(seed, 1)
    laser, driver = scenario.laser, Driver(scenario, robot, frames, frames)
    mapper = RobotMapper(
        scenario.grid.grid, scenario.hrm.cells, scenario.hrm.per_glrm_cell, RULES,
        laser.range_max_m, scenario.robot.slope_max, given_layers(scenario),
    )  # fmt: skip
    for frame in range(0, frames, laser.period_frames):
        scan, pose = driver.scan(frame), driver.pose(frame)
        origin_m = np.array([pose.x_m, pose.y_m, laser.height_above_base_m])
        mapper.step_scan(scan.ranges, DIRECTIONS, np.eye(3), origin_m, scan.stamp_ns)
    return mapper.registers()
