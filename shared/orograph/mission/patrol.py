"""Who drives where: the patrol's orders, kept right while robots fall silent, come back, give up or finish early."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import numpy.typing as npt

from orograph.keys import robot_number
from orograph.messages import SECOND_NS, RobotStatus
from orograph.mission.legs import Legs
from orograph.node import Note
from orograph.scenario import PointM

HEARD_NS = 3 * SECOND_NS
"""A robot is spoken to if one of its last three statuses came; only then can it take a new order."""
LOST_AFTER_NS = 15 * SECOND_NS
"""Silence after which a robot whose services are gone loses its legs: time to start them again."""
SHADOW_MAX_NS = 60 * SECOND_NS
"""Silence after which any robot loses its legs: a minute's drive (150 m) crosses every radio shadow worth the name."""
BALANCE_EVERY_NS = 10 * SECOND_NS
DONOR_WAYPOINTS = 3
GAIN_MIN_M = 10.0
"""Shorter gains are not worth turning a robot round."""
SPLIT_ANEW_FROM = 3
"""So many waypoints without a robot are split anew with everybody's; fewer are slipped into the tours."""
SETTLED = ("idle", "done", "blocked")


@dataclass
class Robot:
    """What the orchestrator knows of a robot and wants of it."""

    name: str
    at_m: PointM
    heard_ns: int
    spoke: bool = False
    state: str = ""
    holds: int = 0
    number: int = 0
    order: list[int] = field(default_factory=list)
    visited: set[int] = field(default_factory=set)
    given_up: set[int] = field(default_factory=set)
    lost: bool = False

    def settled(self) -> bool:
        """Holds what it was last sent, if anything, and has come to rest."""
        return self.spoke and self.number in (0, self.holds) and self.state in SETTLED


class Patrol:
    """Orders of all robots; stepped with statuses in and simulation time as an argument."""

    def __init__(
        self, robots: Sequence[str], starts_m: Sequence[PointM], legs: Legs, now_ns: int,
    ) -> None:  # fmt: skip
        self.robots = {name: Robot(name, start, now_ns) for name, start in zip(robots, starts_m, strict=True)}
        self.visited_ns = np.full(legs.count, -1, np.int64)
        self.visited_by = np.zeros(legs.count, np.uint16)
        self._legs = legs
        self._balanced_ns = now_ns

    # --- what is known ---------------------------------------------------------------------------------------------

    def open(self) -> list[int]:
        """Waypoints that nobody has visited and somebody may still reach."""
        unreached = set(self.unreached())
        return [w for w in range(len(self.visited_ns)) if self.visited_ns[w] < 0 and w not in unreached]

    def unreached(self) -> list[int]:
        """Unvisited waypoints that every robot still able to drive has given up."""
        able = [r for r in self.robots.values() if not r.lost]
        given_up = set.intersection(*(r.given_up for r in able)) if able else set()
        return sorted(w for w in given_up if self.visited_ns[w] < 0)

    def all_visited(self) -> bool:
        """Whether no waypoint was left out."""
        return bool((self.visited_ns >= 0).all())

    def finished(self) -> bool:
        """Nothing is open and every robot that is not lost has come to rest."""
        return not self.open() and all(r.settled() for r in self.robots.values() if not r.lost)

    def left(self, robot: str) -> list[int]:
        """What this robot still has before it, in order."""
        return [w for w in self.robots[robot].order if self._is_for(self.robots[robot], w)]

    def _is_for(self, robot: Robot, waypoint: int) -> bool:
        return self.visited_ns[waypoint] < 0 and waypoint not in robot.given_up

    def _spoken_to(self, now_ns: int) -> list[Robot]:
        return [r for r in self.robots.values() if not r.lost and now_ns - r.heard_ns < HEARD_NS]

    # --- what is heard ---------------------------------------------------------------------------------------------

    def hear(self, name: str, status: RobotStatus, now_ns: int, note: Note) -> None:
        """Take a robot's status; visits of all robots add up, whoever was asked to drive there."""
        robot = self.robots[name]
        if robot.lost:
            robot.lost = False
            note("robot-back", {"robot": name, "silent_s": (now_ns - robot.heard_ns) / SECOND_NS})
        robot.heard_ns, robot.spoke = now_ns, True
        robot.holds, robot.state, robot.at_m = status.mission, status.state, (status.x_m, status.y_m)
        robot.visited |= self._known(status.visited)
        robot.given_up |= self._known(status.given_up)
        for waypoint in sorted(robot.visited):
            if self.visited_ns[waypoint] < 0:
                self.visited_ns[waypoint], self.visited_by[waypoint] = status.stamp_ns, robot_number(name)

    def _known(self, waypoints: npt.NDArray[Any]) -> set[int]:
        return {int(w) for w in waypoints if w < len(self.visited_ns)}

    # --- what is wanted --------------------------------------------------------------------------------------------

    def review(self, number: int, now_ns: int, present: Collection[str], note: Note) -> None:
        """Put all orders right; a robot whose order changes gets mission `number`, greater than any before.

        `present` are the robots whose services live; for the others silence counts sooner.
        """
        self._lose_the_silent(number, now_ns, present, note)
        for robot in self.robots.values():
            self._drop_closed(robot, number, note)
        listeners = self._spoken_to(now_ns)
        if loose := self._loose():
            self._place(loose, listeners, number, note)
        for robot in listeners:
            if robot.number == 0:
                self._give(robot, [], number, note)
        if now_ns - self._balanced_ns >= BALANCE_EVERY_NS:
            self._balanced_ns = now_ns
            self._balance(listeners, number, note)

    def _lose_the_silent(self, number: int, now_ns: int, present: Collection[str], note: Note) -> None:
        for robot in self.robots.values():
            silent_ns = now_ns - robot.heard_ns
            limit_ns = SHADOW_MAX_NS if robot.name in present else LOST_AFTER_NS
            if not robot.lost and silent_ns >= limit_ns:
                robot.lost = True
                note("robot-lost", {"robot": robot.name, "silent_s": silent_ns / SECOND_NS})
                if legs := self.left(robot.name):
                    note("hand-over", {"robot": robot.name, "waypoints": legs})
                self._give(robot, [], number, note)

    def _drop_closed(self, robot: Robot, number: int, note: Note) -> None:
        """Forget what is visited or given up; tell the robot only of what others visited for it."""
        left = self.left(robot.name)
        if set(robot.order) - set(left) - robot.visited - robot.given_up:
            self._give(robot, left, number, note)
        if given_up := [w for w in robot.order if w in robot.given_up and self.visited_ns[w] < 0]:
            note("hand-over", {"robot": robot.name, "waypoints": given_up})
        robot.order = left

    def recall(self, number: int) -> None:
        """The patrol is over: nobody has anything left to visit."""
        for robot in self.robots.values():
            robot.order, robot.number = [], number

    def dismiss(self, name: str, number: int, note: Note) -> None:
        """A robot takes no part any more and is not to be heard: what it had to visit, or says it has, is others'."""
        robot = self.robots[name]
        if legs := self.left(name):
            note("hand-over", {"robot": name, "waypoints": legs})
        its = self.visited_by == robot_number(name)
        self.visited_ns[its], self.visited_by[its] = -1, 0
        robot.visited.clear()
        robot.lost = True
        self._give(robot, [], number, note)

    def _loose(self) -> list[int]:
        taken = {w for r in self.robots.values() if not r.lost for w in r.order}
        return [w for w in self.open() if w not in taken]

    def _place(self, loose: list[int], listeners: list[Robot], number: int, note: Note) -> None:
        """Split anew with everybody who listens, or slip each in where the detour is shortest."""
        placeable = [w for w in loose if any(w not in r.given_up for r in listeners)]
        if len(placeable) >= SPLIT_ANEW_FROM:
            together = sorted({*placeable, *(w for r in listeners for w in r.order)})
            orders = self._legs.split([r.at_m for r in listeners], [r.given_up for r in listeners], together)
            for robot, order in zip(listeners, orders, strict=True):
                self._give(robot, order, number, note)
            return
        for waypoint in placeable:
            willing = [r for r in listeners if waypoint not in r.given_up]
            detours = [self._legs.detour(r.at_m, r.order, waypoint) for r in willing]
            best = min(range(len(willing)), key=lambda i: detours[i][0])
            self._give(willing[best], detours[best][1], number, note)

    def _balance(self, listeners: list[Robot], number: int, note: Note) -> None:
        """Let a robot without work take the end of the longest order."""
        idle = [r for r in listeners if not r.order and r.settled()]
        donors = [r for r in listeners if len(r.order) >= DONOR_WAYPOINTS]
        if not idle or not donors:
            return
        lengths_m = [self._legs.length_m(r.at_m, r.order) for r in donors]
        donor = donors[int(np.argmax(lengths_m))]
        shares = [self._legs.share_end(donor.at_m, donor.order, r.at_m, r.given_up) for r in idle]
        best = min(range(len(idle)), key=lambda i: shares[i][0])
        longest_m, kept, taken = shares[best]
        if longest_m <= max(lengths_m) - GAIN_MIN_M:
            note("hand-over", {"robot": donor.name, "waypoints": taken})
            self._give(donor, kept, number, note)
            self._give(idle[best], taken, number, note)

    def _give(self, robot: Robot, order: list[int], number: int, note: Note) -> None:
        if order == robot.order and robot.number > 0:
            return
        robot.order, robot.number = order, number
        note("mission", {"robot": robot.name, "number": number, "waypoints": list(order)})
