"""The life of a service that follows the world's clock: claim, join, answer every tick, leave its parts behind."""

from __future__ import annotations

import logging
import threading
import time
import uuid
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import replace

from orograph import keys
from orograph.comms.bus import Bus
from orograph.control import Answer, Claim, Grant, Release, Tick
from orograph.messages import Frame
from orograph.node import Node
from orograph.runtime import metrics
from orograph.runtime.briefing import Briefing, await_briefing
from orograph.runtime.host import NodeHost
from orograph.runtime.settings import Settings
from orograph.runtime.watchdog import Watchdog
from orograph.scenario import Scenario
from orograph.stages import StageRecorder
from orograph.storage.recording import Recording

JOIN_EVERY_S = 0.3
CLAIM_EVERY_S = 0.5
EXIT_RELEASED = 75
"""EX_TEMPFAIL: the restart policy starts the process again, and it claims where it is needed more."""

log = logging.getLogger("orograph")


class Ticks:
    """The newest tick that this process has not answered yet."""

    def __init__(self, bus: Bus) -> None:
        self._changed = threading.Condition()
        self._newest: Tick | None = None
        self.ended = False
        bus.hear(keys.TICK, Tick, self._on_tick)

    def _on_tick(self, tick: Tick) -> None:
        with self._changed:
            self._newest = tick
            self.ended = self.ended or tick.end
            self._changed.notify_all()

    def next(self, timeout_s: float) -> Tick | None:
        """The newest tick, taken away; None when none comes in time."""
        with self._changed:
            if self._newest is None:
                self._changed.wait(timeout_s)
            tick, self._newest = self._newest, None
            return tick


def claim(
    bus: Bus, service: str, instance: str, settings: Settings, watchdog: Watchdog, ticks: Ticks
) -> tuple[str, ...]:  # fmt: skip
    """Ask the orchestrator for robots until it grants some; a full fleet leaves this process a spare, said once.

    None are had when the run ends before, or this process is told to stop.
    """
    question = Claim(service, instance, settings.capacity, settings.wanted)
    silence, said = Grant((), "the orchestrator does not answer yet"), ""
    while not watchdog.stop.is_set() and not ticks.ended:
        reply = bus.ask(keys.CLAIM, question, Grant, timeout_s=2.0)
        grant = reply or silence
        if grant.robots:
            return grant.robots
        if grant.reason != said:
            said = grant.reason
            log.info("waiting for a robot: %s", said)
        watchdog.alive(ready=reply is not None)
        watchdog.stop.wait(CLAIM_EVERY_S)
    return ()


class Participant:
    """Steps hosted nodes at every tick, in lockstep or at the world's pace."""

    def __init__(
        self, bus: Bus, host: NodeHost, instance: str, scenario: Scenario, watchdog: Watchdog, ticks: Ticks
    ) -> None:  # fmt: skip
        self._bus, self._host, self._instance, self._watchdog = bus, host, instance, watchdog
        self._frame_ns = scenario.frame_ns
        self._last = Answer(instance, tuple(n.name for n in host.nodes), -1, {}, 0)
        self._answered_s = 0.0
        self._ticks = ticks
        self.released = False
        bus.hear(keys.release_key(instance), Release, self._on_release)

    def run(self) -> None:
        """Until the world ends the run, or this process is told to stop or to claim anew."""
        while not self._watchdog.stop.is_set() and not self.released:
            self._watchdog.alive()
            tick = self._ticks.next(JOIN_EVERY_S)
            if tick is not None and tick.end:
                return
            if tick is not None and self._instance in tick.roster:
                self._take(tick)
            elif time.monotonic() - self._answered_s > JOIN_EVERY_S:
                self._answer()

    def _on_release(self, _: Release) -> None:
        self.released = True

    def _take(self, tick: Tick) -> None:
        if tick.frame > self._last.frame:
            frame = Frame(tick.frame, tick.frame * self._frame_ns, self._frame_ns)
            counted = {} if self._last.frame < 0 else tick.counted
            lost = self._host.step(frame, counted, frozenset(tick.down), tick.lockstep, self._watchdog.stop)
            self._last = replace(self._last, frame=frame.index, sent=dict(self._bus.sent), lost=lost)
        self._answer()

    def _answer(self) -> None:
        self._answered_s = time.monotonic()
        self._bus.tell(keys.done_key(self._instance), self._last)


Built = tuple[Sequence[Node], dict[str, StageRecorder]]
"""Nodes of one process, and the stage recorders of some, by node name."""


def take_part(
    service: str,
    settings: Settings,
    watchdog: Watchdog,
    build: Callable[[Briefing, tuple[str, ...]], Built],
    brief: Callable[[Bus], Briefing | None] | None = None,
) -> int:
    """Run one service process and return its exit code: `build` makes its nodes for the robots it holds.

    `brief` says what runs, by default by asking; it may answer others' queries as well.
    """
    on_radio = settings.radio if service in keys.RADIO_SERVICES else None
    with suppress(InterruptedError), Bus.open(settings.sim, on_radio, watchdog.stop) as bus:
        briefing = brief(bus) if brief is not None else await_briefing(bus, settings.run_dir, watchdog)
        if briefing is None:
            return 0
        instance, ticks = uuid.uuid4().hex, Ticks(bus)
        robots: tuple[str, ...] = ()
        if service in keys.ROBOT_SERVICES:
            robots = claim(bus, service, instance, settings, watchdog, ticks)
            if not robots:
                return 0
        # The token first: building nodes may compile for longer than a claim without one lasts.
        with bus.token(service, instance, robots):
            watchdog.busy()
            released = _follow(service, instance, briefing, bus, watchdog, ticks, build(briefing, robots))
            return EXIT_RELEASED if released else 0
    return 0


def _follow(
    service: str, instance: str, briefing: Briefing, bus: Bus, watchdog: Watchdog, ticks: Ticks, built: Built
) -> bool:  # fmt: skip
    nodes, stages = built
    with Recording(briefing.folder, f"{service}-{instance[:8]}") as recording:
        host = NodeHost(bus, nodes, briefing.scenario, recording)
        metrics.FIGURES.time_stages(stages.values())
        log.info("ready: %s", ", ".join(n.name for n in host.nodes))
        participant = Participant(bus, host, instance, briefing.scenario, watchdog, ticks)
        participant.run()
        watchdog.busy()
        host.save(stages)
    return participant.released
