"""Stage times as in the paper's Table 2, and its Tables 2 and 3 themselves."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from orograph import keys
from orograph.arrays import I64
from orograph.stages import STAGES
from orograph.storage.parts import RunParts
from orograph.storage.results import Spread

PAPER_ROBOTS = ("robot_001", "robot_002", "robot_003")
PAPER_TABLE_2_MS: Mapping[str, tuple[int, int, int]] = {
    "points": (55, 55, 70),
    "height": (5, 5, 5),
    "gradients": (130, 140, 307),
    "confidence": (82, 60, 70),
    "occupation": (30, 30, 35),
    "fuse_hrm": (5, 1, 5),
    "rescale": (110, 105, 110),
    "fold": (4, 5, 5),
}
"""Stage -> milliseconds of the paper's three robots."""
PAPER_TABLE_3_S: Mapping[int, int] = {1: 445, 2: 310, 3: 190}
"""Robots -> mapping time [s of simulation]."""


def spread(durations_ns: I64) -> Spread:
    """Of durations (n,) [ns]; NaN where there were none."""
    if not durations_ns.size:
        return Spread(p50=math.nan, p95=math.nan)
    p50, p95 = np.quantile(durations_ns, [0.5, 0.95]) / 1e6
    return Spread(p50=float(p50), p95=float(p95))


@dataclass(frozen=True)
class Table2Row:
    """One stage: the paper's name for it, the paper's times, and ours per robot."""

    stage: str
    title: str
    paper_ms: tuple[int, int, int]
    robots: Mapping[str, Spread]
    all: Spread


def table_2(parts: RunParts) -> list[Table2Row]:
    """The eight rows; the last is measured in the map manager, once for all robots (mapping.md section 6)."""
    return [_row(parts, stage) for stage in STAGES]


def _row(parts: RunParts, stage: str) -> Table2Row:
    nodes = {robot: keys.node(keys.MAPPING, robot) for robot in parts.robots}
    per_robot = {
        robot: durations for robot, node in nodes.items() if (durations := _durations(parts, node, stage)).size
    }
    manager = _durations(parts, keys.node(keys.MANAGER), stage)
    pooled = np.concatenate([manager, *per_robot.values()])
    spreads = {robot: spread(durations) for robot, durations in per_robot.items()}
    return Table2Row(stage, STAGES[stage], PAPER_TABLE_2_MS[stage], spreads, spread(pooled))


def _durations(parts: RunParts, node: str, stage: str) -> I64:
    return np.asarray(parts.stages_ns.get(node, {}).get(stage, ()), np.int64)
