"""The orchestrator's step object: patrol orders out, statuses in, phases of the run, its end."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from orograph import keys
from orograph.messages import (
    PHASES,
    SECOND_NS,
    Envelope,
    Frame,
    ManagerStatus,
    MappingStatus,
    Mission,
    Phase,
    RobotStatus,
    RunEnd,
)
from orograph.mission.distances import DrivingDistances
from orograph.mission.legs import Legs
from orograph.mission.patrol import HEARD_NS, LOST_AFTER_NS, Patrol
from orograph.mission.phases import END, FLUSH, MAPPING, RunPhases
from orograph.node import Every, Note, Send
from orograph.nodes.status_board import StatusBoard
from orograph.scene.site import Site

LISTEN_NS = 3 * SECOND_NS
"""After a restart: three statuses of every robot within radio, before anything is ordered."""


class OrchestratorNode:
    """Mapping Orchestration: deals the patrol out, hands over, ends the run."""

    def __init__(self, site: Site, robots: tuple[str, ...], seed: int) -> None:
        self.name, scenario = keys.node(keys.ORCHESTRATOR), site.scenario
        self._robots = robots
        self._starts_m = [(s.x_m, s.y_m) for s in scenario.starts[: len(robots)]]
        self._scenario, prior = scenario, site.prior_map
        # Not in a step, whose time is limited: 2 000 waypoints take 10 s on a small map, minutes on a large one.
        self._legs = Legs(scenario.patrol, DrivingDistances(prior.occupation, prior.grid))
        self._phases = RunPhases(robots, int(scenario.duration_max_s * SECOND_NS))
        self._patrol: Patrol | None = None
        self._board = StatusBoard(robots, scenario.name, scenario.grid.grid.size)
        self.status = self._board.status(0, "starting", None)
        """How things stood at the last full second, replaced whole: any thread may read it."""
        self.revoked: frozenset[str] = frozenset()
        """Robots that the map manager has revoked, by its last word, replaced whole: any thread may read it."""
        self._dismissed: frozenset[str] = frozenset()
        self._present: Collection[str] = robots
        self._speaks_from_ns = 0
        self._now_ns = 0
        self._beat = Every(SECOND_NS)
        self._orders_at_start: dict[str, list[int]] = {}

    def present(self, robots: Collection[str]) -> None:
        """Robots whose services are all claimed; the shell says so whenever it changes."""
        self._present = frozenset(robots)

    def step(self, frame: Frame, inbox: Sequence[Envelope], send: Send, note: Note) -> None:
        """Hear, put orders and phase right once a second, repeat them."""
        self._now_ns = frame.stamp_ns
        patrol = self._patrol or self._begin(frame)
        for envelope in inbox:
            self._hear(envelope, patrol, note)
        beat = self._beat.due(frame.stamp_ns)
        if beat:
            self._dismiss(frame, patrol, note)
        if beat and frame.stamp_ns >= self._speaks_from_ns:
            self._direct(frame, patrol, note)
            self._speak(patrol, send)
        if beat:
            self.status = self._board.status(frame.stamp_ns, self._phases.name, patrol)
        if self._phases.name == END:
            send(keys.SIM, keys.WORLD, RunEnd(self._phases.complete, self._phases.copies_equal))

    def _begin(self, frame: Frame) -> Patrol:
        """Frame 0 is a new run; any later first frame is a restart, which listens before it speaks."""
        self._patrol = Patrol(self._robots, self._starts_m, self._legs, frame.stamp_ns)
        for robot in set(self._robots) - set(self._present):
            self._patrol.robots[robot].lost = True  # not there yet: nothing is ordered before it speaks
        self._speaks_from_ns = 0 if frame.index == 0 else frame.stamp_ns + LISTEN_NS
        return self._patrol

    def _hear(self, envelope: Envelope, patrol: Patrol, note: Note) -> None:
        robot = keys.split(envelope.sender)[1]
        self._board.hear(robot, envelope.message, self._now_ns)
        match envelope.message:
            case RobotStatus() | MappingStatus() if robot in self.revoked:
                return
            case RobotStatus() as status if robot in patrol.robots:
                patrol.hear(robot, status, self._now_ns, note)
            case MappingStatus() as report if robot in patrol.robots:
                self._phases.hear_mapping(robot, report)
            case ManagerStatus() as state:
                self._phases.hear_manager(state)
                self._hear_revoked(state)

    def _hear_revoked(self, status: ManagerStatus) -> None:
        """The manager's list, by its fresh word alone: an old one is a late or a repeated one."""
        if 0 <= self._now_ns - status.stamp_ns <= HEARD_NS:
            numbers = set(status.revoked.tolist())
            self.revoked = frozenset(robot for robot in self._robots if keys.robot_number(robot) in numbers)

    def _dismiss(self, frame: Frame, patrol: Patrol, note: Note) -> None:
        """Robots that were revoked since are told to stay where they are; others drive where they were to."""
        if self._phases.name != MAPPING:
            return
        for robot in sorted(self.revoked - self._dismissed):
            patrol.dismiss(robot, frame.index + 1, note)
        self._dismissed = self.revoked

    def _direct(self, frame: Frame, patrol: Patrol, note: Note) -> None:
        if self._phases.name == MAPPING and not patrol.finished():
            patrol.review(frame.index + 1, frame.stamp_ns, self._present, note)
            self._orders_at_start = self._orders_at_start or {n: list(r.order) for n, r in patrol.robots.items()}
        self._phases.gone = self._gone(patrol)
        finished = patrol.finished() or self.revoked.issuperset(self._robots)
        if self._phases.step(frame.stamp_ns, finished, patrol.all_visited()):
            note("phase", {"name": self._phases.name})
            if self._phases.name == FLUSH:
                patrol.recall(frame.index + 1)
            if self._phases.name == END:
                note("run-end", {"complete": self._phases.complete, "copies_equal": self._phases.copies_equal})

    def _gone(self, patrol: Patrol) -> set[str]:
        silent = {n for n, r in patrol.robots.items() if self._now_ns - r.heard_ns >= LOST_AFTER_NS}
        return (silent - set(self._present)) | self.revoked

    def _speak(self, patrol: Patrol, send: Send) -> None:
        for name, robot in patrol.robots.items():
            if robot.number:
                order = np.array(patrol.left(name), np.uint16)
                flush = self._phases.name != MAPPING
                send(keys.RADIO, keys.node(keys.NAVIGATOR, name), Mission(robot.number, order, flush))
        send(keys.RADIO, keys.group(keys.MAPPING), Phase(self._phases.name))

    def telemetry(self) -> Mapping[str, float]:
        """Robots heard, waypoints left and unreached, phase (0 mapping, 1 flush, 2 end), silence of each robot [s]."""
        out = {"phase": float(PHASES.index(self._phases.name))}
        if self._patrol is not None:
            silent_ns = {name: self._now_ns - r.heard_ns for name, r in self._patrol.robots.items()}
            out["robots_heard"] = float(sum(ns < HEARD_NS for ns in silent_ns.values()))
            out["waypoints_left"] = float(len(self._patrol.open()))
            out["waypoints_unreached"] = float(len(self._patrol.unreached()))
            out |= {f"silence_{name}_s": ns / SECOND_NS for name, ns in silent_ns.items()}
        return out

    def _gone_of_themselves(self) -> set[str]:
        return set(self._phases.gone) - self.revoked

    def artifacts(self) -> Mapping[str, npt.NDArray[Any]]:
        """legs_<robot>, visited_ns (-1 never), visited_by (robot number or 0), unreached, phase names and stamps; gone:
        numbers of the robots that the end did not wait for.
        """
        out: dict[str, npt.NDArray[Any]] = {
            "gone": np.array(sorted(keys.robot_number(robot) for robot in self._gone_of_themselves()), np.uint16),
            "phase_names": np.array(list(self._phases.began_ns)),
            "phase_stamps_ns": np.array(list(self._phases.began_ns.values()), np.int64),
        }
        if self._patrol is not None:
            out["visited_ns"], out["visited_by"] = self._patrol.visited_ns, self._patrol.visited_by
            out["unreached"] = np.array(self._patrol.unreached(), np.uint16)
            out |= {f"legs_{name}": np.array(order, np.uint16) for name, order in self._orders_at_start.items()}
        return out
