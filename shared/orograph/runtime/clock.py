"""The world's loop: it owns simulation time, in lockstep with everybody or at a pace (architecture.md, "Time")."""

from __future__ import annotations

import logging
import time
from collections.abc import Callable, Iterable

from orograph.comms.bus import Bus
from orograph.messages import Frame
from orograph.runtime.barrier import Barrier
from orograph.runtime.host import NodeHost
from orograph.runtime.watchdog import Watchdog
from orograph.scenario import Scenario

FAREWELL_S = 10.0
LATE_FRAMES_MAX = 5
"""What is late by no more than these is made good; after a longer pause the pace goes on from there."""

log = logging.getLogger("orograph.clock")


class Pace:
    """When the next frame is due: every `period_s` [s of wall time] from `begin_s` on."""

    def __init__(self, period_s: float, begin_s: float) -> None:
        self._period_s, self._due_s = period_s, begin_s

    def wait_s(self, now_s: float) -> float:
        """How long to wait after a frame that was done at `now_s`."""
        self._due_s += self._period_s
        if now_s - self._due_s > LATE_FRAMES_MAX * self._period_s:
            self._due_s = now_s
        return max(0.0, self._due_s - now_s)


class Clock:
    """Drives frames until `ended()`; `down()` names the robots without radio after the frame just stepped.

    `roster` is told every frame which nodes take part; it returns those that the first frame still waits for.
    """

    def __init__(
        self, bus: Bus, host: NodeHost, scenario: Scenario, watchdog: Watchdog,
        ended: Callable[[], bool], down: Callable[[], Iterable[str]], roster: Callable[[set[str]], set[str]],
    ) -> None:  # fmt: skip
        self._bus, self._host, self._watchdog = bus, host, watchdog
        self._frame_ns, self._scale = scenario.frame_ns, scenario.time_scale
        self._ended, self._down, self._roster = ended, down, roster
        self._barrier = Barrier(bus)
        self.frame, self.wall_time_s, self.lost = 0, 0.0, 0
        self.deterministic = False
        """Known once `run` is over: the same scenario and seed would give the same map again."""

    def await_start(self) -> None:
        """Hold frame 0 until all that are needed take part; what is missing is said every few seconds."""
        said_s = time.monotonic()
        while (missing := self._roster(self._barrier.nodes)) and not self._watchdog.stop.is_set():
            self._watchdog.alive()
            self._barrier.await_nodes(missing, self._watchdog.stop)
            if time.monotonic() - said_s > 5.0:
                said_s = time.monotonic()
                log.info("waiting for %s", ", ".join(sorted(missing)))

    def run(self) -> None:
        """Frame after frame until the end."""
        begin_s = time.monotonic()
        pace = Pace(0.0 if self._scale == "max" else self._frame_ns * 1e-9 / self._scale, begin_s)
        counted: dict[str, int] = {}
        down: frozenset[str] = frozenset()
        while not self._watchdog.stop.is_set() and not self._ended():
            self._watchdog.alive()
            counted, down = self._turn(counted, down)
            self.frame += 1
            self._watchdog.stop.wait(pace.wait_s(time.monotonic()))
        self.wall_time_s = time.monotonic() - begin_s
        self.lost += self._barrier.lost
        self.deterministic = self._scale == "max" and self._ended() and self._barrier.steady and not self.lost
        self._bid_farewell()

    def _turn(self, counted: dict[str, int], down: frozenset[str]) -> tuple[dict[str, int], frozenset[str]]:
        lockstep = self._scale == "max"
        self._roster(self._barrier.nodes)
        roster = self._barrier.tick(self.frame, counted, down, lockstep)
        frame = Frame(self.frame, self.frame * self._frame_ns, self._frame_ns)
        self.lost += self._host.step(frame, counted, down, lockstep, self._watchdog.stop)
        sent = dict(self._bus.sent)
        if lockstep:
            sent |= self._barrier.await_answers(self.frame, roster, self._watchdog.stop)
        return sent, frozenset(self._down())

    def _bid_farewell(self) -> None:
        """Say that the run is over until all who took part have gone."""
        deadline = time.monotonic() + FAREWELL_S
        while self._barrier.nodes and time.monotonic() < deadline:
            self._watchdog.alive()
            self._barrier.tick(self.frame, end=True)
            time.sleep(0.1)
