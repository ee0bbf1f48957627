"""A finished run's film, from what its folder holds."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path

import numpy as np

from orograph import keys
from orograph.arrays import F64
from orograph.console.film import Film
from orograph.console.live import SCAN_POINTS
from orograph.geometry import laser_position_m, ray_directions, rotation_from_quaternion
from orograph.nodes.cell_history import CHANGE
from orograph.points import points_from_ranges
from orograph.scene.site import Site
from orograph.storage.parts import Arrays, RunParts, read_parts
from orograph.storage.run_folder import FolderError


def played(out: Path) -> Film:
    """The film of a run folder; raises FolderError where it holds none, or one of a program that kept less."""
    parts = read_parts(out)
    changes, world = parts.of(keys.MANAGER).get("changes"), parts.of(keys.WORLD)
    if changes is None or changes.dtype != CHANGE:
        raise FolderError(f"{out}: keeps no course of its map, as a run of this version does: run it again to see it")
    if missing := [robot for robot in parts.robots if f"{robot}_truth" not in world]:
        raise FolderError(f"{out}: the world left no course of {missing[0]}: the run did not end by itself")
    return Film(
        Site(parts.scenario), parts.scenario.title,
        {robot: _course(world, robot) for robot in parts.robots},
        [world[f"vehicle_{i:03d}_path"] for i in range(len(parts.scenario.vehicles))],
        {robot: np.asarray(parts.of(keys.MAPPING, robot).get("backlog", np.zeros((0, 2))), np.float64)
         for robot in parts.robots},
        changes, parts.events, dict(_last_scans(parts)), lambda: parts.of(keys.MANAGER)["registers"],
    )  # fmt: skip


def _course(world: Arrays, robot: str) -> F64:
    truth, radio = world[f"{robot}_truth"], world[f"{robot}_radio"]
    return np.column_stack([truth[:, :5], radio])


def _last_scans(parts: RunParts) -> Iterator[tuple[str, Callable[[], F64]]]:
    laser = parts.scenario.laser
    for robot in parts.robots:
        arrays = parts.of(keys.LASER, robot)
        if "last_ranges" in arrays:
            R_map_robot = rotation_from_quaternion(arrays["last_quaternion_wxyz"])
            eye_m = laser_position_m(laser, R_map_robot, arrays["last_position_m"])
            points, _ = points_from_ranges(arrays["last_ranges"], ray_directions(laser), R_map_robot, eye_m)
            yield robot, partial(_known, points[:: max(1, len(points) // SCAN_POINTS)])


def _known(points: F64) -> F64:
    return points
