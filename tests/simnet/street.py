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
        "laser": {"rings": 5, "columns": 24, "range_max_m": 20, "period_frames": 3,
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
PATROL = np.arange(len(SCENARIO.patrol), dtype="<u2")
PERIOD = SCENARIO.laser.period_frames
WALLS = 0.05
"""Share of the rays that hit something that is not there the next time."""
NOISE = 0.01


class Silent:
    """A node that nobody asks."""

    def telemetry(self) -> Mapping[str, float]:
        return {}

    def artifacts(self) -> Mapping[str, np.ndarray]:
        return {}


class Laser(Silent):
    """Scans every few frames, until frame `scans_until`.

    What is seen depends on (seed, robot, frame) alone, so a run without faults sees the same.
    """

    def __init__(self, seed: int, robot: str, scans_until: int) -> None:
        self.name, self._to = keys.node(keys.LASER, robot), keys.node(keys.MAPPING, robot)
        self._seed, self._robot, self._until = seed, robot, scans_until

    def step(self, frame: Frame, inbox: Sequence[Envelope], send: Send, note: Note) -> None:
        if frame.index < self._until and frame.index % PERIOD == 0:
            send(keys.SIM, self._to, scan_of(self._seed, self._robot, frame.index))


class Navigator(Silent):
    """Follows a given path; from frame `done_at` on it says that the patrol is driven.

    A robot of an even number knows its pose a frame later.
    """

    def __init__(self, seed: int, robot: str, done_at: int) -> None:
        self.name, self._mapping = keys.node(keys.NAVIGATOR, robot), keys.node(keys.MAPPING, robot)
        self._seed, self._robot, self._done_at = seed, robot, done_at
        self._late = 1 - keys.robot_number(robot) % 2
        self._mission = 0

    def step(self, frame: Frame, inbox: Sequence[Envelope], send: Send, note: Note) -> None:
        for envelope in inbox:
            if isinstance(envelope.message, Mission):
                self._mission = max(self._mission, envelope.message.number)
        posed = frame.index - self._late
        if posed >= 0 and posed % PERIOD == 0:
            send(keys.SIM, self._mapping, pose_of(self._seed, self._robot, posed))
        if frame.index % STATUS_FRAMES == keys.robot_number(self._robot):
            send(keys.RADIO, keys.ORCHESTRATOR, self._status(frame))

    def _status(self, frame: Frame) -> RobotStatus:
        state, visited = ("done", PATROL) if frame.index >= self._done_at else ("driving", PATROL[:0])
        pose = pose_of(self._seed, self._robot, frame.index)
        return RobotStatus(frame.stamp_ns, self._mission, visited, PATROL[:0], state, pose.x_m, pose.y_m)


def pose_of(seed: int, robot: str, frame: int) -> Pose:
    x0, y0, x1, y1 = SCENARIO.grid.grid.extent_m
    turn = 0.03 * frame + 2.1 * keys.robot_number(robot) + 0.37 * seed
    x_m = x0 + (0.5 + 0.3 * math.sin(2.2 * turn)) * (x1 - x0)
    y_m = y0 + (0.5 + 0.4 * math.cos(turn)) * (y1 - y0)
    return Pose(frame * SCENARIO.frame_ns, x_m, y_m, 0.0, 0.0, 0.0, 0.0, 0.1)


@lru_cache(maxsize=2000)
def scan_of(seed: int, robot: str, frame: int) -> Scan:
    """What a level laser has of level ground, with noise and walls."""
    rng = np.random.default_rng([seed, 3, keys.robot_number(robot), frame])
    ranges_m = GROUND_M * (1 + NOISE * rng.standard_normal(GROUND_M.shape))
    ranges_m = np.where(rng.random(GROUND_M.shape) < WALLS, 0.7 * ranges_m, ranges_m)
    units = np.where(ranges_m < SCENARIO.laser.range_max_m, ranges_m / RANGE_UNIT_M, 0)
    return Scan(frame * SCENARIO.frame_ns, units.astype("<u2"))


def street_of(seed: int, robots: int) -> Scenario:
    return SCENARIO.model_copy(update={"seed": seed, "robots": robots})


@lru_cache(maxsize=2000)
def mapped_alone(seed: int, robot: str, frames: int) -> np.ndarray:
    """A robot's registers (UPDATE) over the scans of so many frames, had nobody ever disturbed or answered it."""
    mapper = RobotMapper(
        SCENARIO.grid.grid, SCENARIO.hrm.cells, SCENARIO.hrm.per_glrm_cell, RULES, SCENARIO.laser.range_max_m,
        SCENARIO.robot.slope_max, given_layers(SCENARIO),
    )  # fmt: skip
    for frame in range(0, frames, PERIOD):
        scan, pose = scan_of(seed, robot, frame), pose_of(seed, robot, frame)
        origin_m = np.array([pose.x_m, pose.y_m, SCENARIO.laser.height_above_base_m])
        mapper.step_scan(scan.ranges, DIRECTIONS, np.eye(3), origin_m, scan.stamp_ns)
    return mapper.registers()
