"""An orchestrator with robots that merely drive straight, along an empty street."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np
from orograph import keys
from orograph.messages import (
    Envelope,
    Frame,
    ManagerStatus,
    MappingStatus,
    Message,
    Mission,
    Phase,
    RobotStatus,
    RunEnd,
)  # fmt: skip
from orograph.nodes.orchestrator import OrchestratorNode
from orograph.scenario import GridSpec, Scenario, Start
from orograph.scene.site import Site

FRAME_NS = 100_000_000
SPEED_MPS = 2.0
Event = tuple[float, str, dict[str, Any]]


def street(robots: int, waypoints: int, **fields: Any) -> Scenario:
    """An empty plane, 400 m of street from west to east, robots at its western and eastern end by turns."""
    return Scenario(
        name="street", title="A street", base_station_m=(5.0, 5.0), grid=GridSpec(rows=20, cols=90), robots=robots,
        starts=tuple(Start(x_m=10.0 + 420.0 * (i % 2), y_m=10.0 + 20.0 * i) for i in range(robots)),
        patrol=tuple((30.0 + 380.0 * i / waypoints, 50.0) for i in range(waypoints)), **fields,
    )  # fmt: skip


class Driver:
    """A robot by its own account: drives straight to its next waypoint, reports every second, keeps what it has."""

    def __init__(self, scenario: Scenario, robot: str) -> None:
        start = scenario.starts[keys.robot_number(robot) - 1]
        self.robot, self.patrol, self.at_m = robot, scenario.patrol, (start.x_m, start.y_m)
        self.number, self.order, self.flush = 0, [], False
        self.visited: list[int] = []
        self.given_up: list[int] = []
        self.cannot: set[int] = set()
        self.deaf = self.dead = self.jammed = False

    def hear(self, mission: Mission) -> None:
        if mission.number > self.number:
            self.number, self.order, self.flush = mission.number, mission.waypoints.tolist(), mission.flush

    def drive(self) -> None:
        left = [w for w in self.order if w not in [*self.visited, *self.given_up]]
        if not left or self.dead or self.jammed:
            return
        goal = self.patrol[left[0]]
        away_m, step_m = math.dist(goal, self.at_m), SPEED_MPS * FRAME_NS * 1e-9
        if left[0] in self.cannot:
            self.given_up.append(left[0])
        elif away_m <= step_m:
            self.at_m = goal
            self.visited.append(left[0])
        else:
            share = step_m / away_m
            self.at_m = tuple(a + share * (g - a) for a, g in zip(self.at_m, goal, strict=True))  # type: ignore[assignment]

    def status(self, now_ns: int) -> RobotStatus:
        done = all(w in [*self.visited, *self.given_up] for w in self.order)
        state = "idle" if self.number == 0 else "done" if done else "driving"
        lists = (np.array(a, "<u2") for a in (self.visited, self.given_up))
        return RobotStatus(now_ns, self.number, *lists, state, *self.at_m)


class Run:
    """Orchestrator, drivers and a manager whose map is one number, in synchronous rounds."""

    def __init__(self, scenario: Scenario) -> None:
        self.scenario, self.robots = scenario, tuple(keys.robot_id(i + 1) for i in range(scenario.robots))
        self.node = OrchestratorNode(Site(scenario), self.robots, 1)
        self.drivers = {r: Driver(scenario, r) for r in self.robots}
        self.events: list[Event] = []
        self.sent: list[tuple[float, str, str, Message]] = []
        self.phase, self.end, self.unflushed = "", None, set[str]()
        self.copy_hash = dict.fromkeys(self.robots, b"m" * 16)
        self.revoked = np.zeros(0, "<u2")
        self._frame, self._inbox = 0, []

    def restart(self) -> None:
        self.node = OrchestratorNode(Site(self.scenario), self.robots, 1)

    @property
    def now_s(self) -> float:
        return self._frame * FRAME_NS * 1e-9

    def step(self) -> None:
        frame = Frame(self._frame, self._frame * FRAME_NS, FRAME_NS)
        out: list[tuple[str, str, Message]] = []

        def note(kind: str, fields: Mapping[str, Any]) -> None:
            self.events.append((frame.stamp_ns * 1e-9, kind, dict(fields)))

        self.node.step(frame, sorted(self._inbox, key=lambda e: (e.sender, e.index)), lambda *m: out.append(m), note)
        self._inbox = []
        for plane, to, message in out:
            self.sent.append((self.now_s, plane, to, message))
            self._deliver(to, message)
        for robot, driver in self.drivers.items():
            driver.drive()
            if self._frame % 10 == 0 and not driver.deaf and not driver.dead:
                self._report(robot, driver, frame.stamp_ns)
        if self._frame % 10 == 0:
            self._post(keys.MANAGER, ManagerStatus(frame.stamp_ns, 7, b"m" * 16, 0, self.revoked))
        self._frame += 1

    def _report(self, robot: str, driver: Driver, now_ns: int) -> None:
        self._post(keys.node(keys.NAVIGATOR, robot), driver.status(now_ns))
        flushed = self.phase == "flush" and robot not in self.unflushed
        self._post(keys.node(keys.MAPPING, robot), MappingStatus(now_ns, flushed, 0, 7, self.copy_hash[robot]))

    def _post(self, sender: str, message: Message) -> None:
        self._inbox.append(Envelope(keys.RADIO, keys.ORCHESTRATOR, sender, self._frame, 0, message))

    def _deliver(self, to: str, message: Message) -> None:
        if isinstance(message, Mission):
            driver = self.drivers[keys.split(to)[1]]
            if not driver.deaf and not driver.dead:
                driver.hear(message)
        elif isinstance(message, Phase):
            self.phase = message.name
        elif isinstance(message, RunEnd):
            self.end = message

    def until(self, seconds: float) -> None:
        """Run to this simulation time, or to the end of the run."""
        while self.now_s < seconds and self.end is None:
            self.step()

    def visited(self) -> set[int]:
        return {w for d in self.drivers.values() for w in d.visited}

    def noted(self, kind: str) -> list[tuple[float, dict[str, Any]]]:
        return [(at_s, fields) for at_s, k, fields in self.events if k == kind]


def everything(run: Run) -> set[int]:
    return set(range(len(run.scenario.patrol)))
