"""A made-up street in which a car parks and leaves, a house is built and pulled down, and a car drives by.

No mission: a robot stands or shuttles on rails, its pose is the true one, and its laser sees the scene of the moment.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from bench.map_replay import Replay
from orograph.arrays import F64
from orograph.geometry import laser_position_m
from orograph.judge.map_changes import time_to_clear_s, time_to_find_s
from orograph.judge.map_obstacles import Body, remains, shows
from orograph.randomness import key
from orograph.scenario import Building, Change, Parked, Scenario
from orograph.scene import build_scene
from orograph.scene.bodies import standing_robot
from orograph.scene.changes import epoch
from orograph.sensing.bodies import NO_BOXES, Boxes
from orograph.sensing.laser import RangeImager

STREET = Scenario.model_validate({
    "name": "street", "title": "A street that changes", "starts": [{"x_m": 70, "y_m": 100}], "robots": 1,
    "base_station_m": [70, 100], "patrol": [[125, 100]], "grid": {"rows": 40, "cols": 40},
    "hrm": {"cells": 240},
    "buildings": [{"footprint": [[x, y], [x + 22, y], [x + 22, y + 12], [x, y + 12]], "height_m": 9}
                  for y in (80.3, 112.2) for x in (40.4, 124.3)],
})  # fmt: skip
HOUSE = Building(footprint=((92.3, 107.5), (102.3, 107.5), (102.3, 117.5), (92.3, 117.5)), height_m=6.0)
PARKED = Parked(x_m=97.0, y_m=94.5)
CAR_M = np.array([4.2, 1.8, 1.6])
LANE_FROM_M, LANE_Y_M, CAR_MPS = 72.0, 104.0, 5.0
RAIL_M, ROBOT_MPS = (70.0, 125.0), 2.5
STAND_M = 88.0
BEGIN_S, PRESENT_S, AFTER_S = 88.0, 88.0, 132.0
"""Absent, present and absent again for so long: four passes, four passes, six passes."""
PASSING_S = 10.0
"""How long a car that drives by is in the street."""
PERIOD_NS = 400_000_000


@dataclass(frozen=True)
class Course:
    """One change and one way of looking at it."""

    what: str
    """`car` (parks, leaves), `house` (built, removed) or `traffic` (a car drives by)."""
    robot: str
    """`passing` or `standing`."""


COURSES = tuple(Course(what, robot) for what in ("car", "house", "traffic") for robot in ("passing", "standing"))


@dataclass(frozen=True, eq=False)
class View:
    """One scan of the course: time, robot and range image, and what is there."""

    stamp_s: float
    R_map_robot: F64
    position_m: F64
    ranges: np.ndarray
    bodies: tuple[Body, ...]


def views(course: Course, seed: int) -> Iterator[View]:
    """The scans of a course."""
    street, still, imagers = _changing(course), build_scene(STREET), {}
    for k in range(_scans(course)):
        stamp_s = k * PERIOD_NS * 1e-9
        if (now := epoch(street, k * PERIOD_NS)) not in imagers:
            imagers[now] = RangeImager(build_scene(street, k * PERIOD_NS), street.laser)
        there = course.what == "traffic" and BEGIN_S <= stamp_s < BEGIN_S + PASSING_S
        bodies = (_passer_by(stamp_s),) if there else ()
        R_map_robot, position_m = standing_robot(still, *_on_rails(course, stamp_s))
        ranges = imagers[now].image(R_map_robot, position_m, boxes(bodies), key(seed, "street", frame=k))
        yield View(stamp_s, R_map_robot, position_m, ranges, bodies)


def _changing(course: Course) -> Scenario:
    end_s = BEGIN_S + PRESENT_S
    changes = {
        "car": [Change(at_s=BEGIN_S, until_s=end_s, park=PARKED)],
        "house": [Change(at_s=BEGIN_S, until_s=end_s, build=HOUSE)],
        "traffic": [],
    }
    return STREET.model_copy(update={"changes": tuple(changes[course.what])})


def _scans(course: Course) -> int:
    return math.ceil((BEGIN_S + _present_s(course) + AFTER_S) * 1e9 / PERIOD_NS)


def _present_s(course: Course) -> float:
    return PASSING_S if course.what == "traffic" else PRESENT_S


def _passer_by(stamp_s: float) -> Body:
    return Body(np.array([LANE_FROM_M + CAR_MPS * (stamp_s - BEGIN_S), LANE_Y_M, 0.0]), CAR_M, np.eye(3))


def boxes(bodies: tuple[Body, ...]) -> Boxes:
    """Bodies as the ray caster takes them."""
    if not bodies:
        return NO_BOXES
    up = [np.array([0.0, 0.0, b.size_m[2] / 2]) for b in bodies]
    centres_m = np.array([b.foot_m + z for b, z in zip(bodies, up, strict=True)])
    return Boxes(centres_m, np.array([b.size_m / 2 for b in bodies]), np.array([b.R_map_body.T for b in bodies]))


def _on_rails(course: Course, stamp_s: float) -> tuple[float, float, float]:
    if course.robot == "standing":
        return STAND_M, 100.0, 0.0
    length_m = RAIL_M[1] - RAIL_M[0]
    along_m = ROBOT_MPS * stamp_s % (2 * length_m)
    back = along_m > length_m
    x_m = RAIL_M[0] + (2 * length_m - along_m if back else along_m)
    return x_m, 100.0, math.pi if back else 0.0


def run_course(seen: Sequence[View], course: Course, rules: str, tick: Callable[[], None]) -> dict[str, float | None]:
    """`found_s` and `cleared_s` in what planning is told by one rule set: None for never, NaN for nothing to clear.

    Found: two touching blocked cells lie on it. Cleared: no blocked cell is left on its place, for traffic on its lane.
    """
    replay, end_s = Replay(STREET, rules), BEGIN_S + _present_s(course)
    place, shown = _place(course), []
    for view in seen:
        eye_m = laser_position_m(STREET.laser, view.R_map_robot, view.position_m)
        planning = replay.map(1, view.ranges, view.R_map_robot, eye_m, round(view.stamp_s * 1e9))
        there = view.bodies[0] if view.bodies else place
        left = view.stamp_s >= end_s
        shown.append(remains(planning.blocked, planning.grid, place) if left else
                     shows(planning.blocked, planning.grid, there))  # fmt: skip
        tick()
    stamps_s, shows_it = np.array([view.stamp_s for view in seen]), np.array(shown)
    before = stamps_s < end_s
    found_s = time_to_find_s(stamps_s[before], shows_it[before], BEGIN_S)
    cleared_s = time_to_clear_s(stamps_s, shows_it, end_s)
    return {"found_s": found_s, "cleared_s": math.nan if found_s is None and cleared_s == 0 else cleared_s}


def _place(course: Course) -> Body:
    if course.what == "car":
        return Body(np.array([PARKED.x_m, PARKED.y_m, 0.0]), np.array(PARKED.size_m), np.eye(3))
    if course.what == "house":
        low, high = np.array(HOUSE.footprint[0]), np.array(HOUSE.footprint[2])
        return Body(np.array([*(low + high) / 2, 0.0]), np.array([*(high - low), HOUSE.height_m]), np.eye(3))
    driven_m = CAR_MPS * PASSING_S
    middle_m = np.array([LANE_FROM_M + driven_m / 2, LANE_Y_M, 0.0])
    return Body(middle_m, CAR_M + np.array([driven_m, 0.0, 0.0]), np.eye(3))


def worst(times: Sequence[dict[str, float | None]]) -> dict[str, float | None]:
    """Of several runs of one course: the longest times, None for never first, NaN for nothing to clear last."""
    out: dict[str, float | None] = {}
    for name in times[0]:
        each = [math.inf if (time := t[name]) is None else time for t in times]
        longest = max((time for time in each if not math.isnan(time)), default=math.nan)
        out[name] = None if math.isinf(longest) else longest
    return out
