"""Junk on every control key over a real router: it is counted, and the same session goes on hearing."""

from __future__ import annotations

import threading
from collections.abc import Callable
from contextlib import ExitStack

import msgpack
import zenoh
from orograph import keys
from orograph.comms import wire
from orograph.comms.bus import Bus
from orograph.control import Answer, Claim, CurrentRun, Grant, Release, Tick
from orograph.runtime.barrier import Barrier
from orograph.runtime.claims import Claims
from orograph.runtime.participant import Ticks
from polling import until

STOP = threading.Event()
JUNK = (
    b"", b"\xc1", *map(msgpack.packb, (7, {}, [1, 2], [1, {}], [1, {"frame": True}], [2, {}])),
    wire.encode(Release()), wire.encode(Grant((), "no")),
)  # fmt: skip


def errors(bus: Bus, kind: str) -> Callable[[], int]:
    return lambda: bus.callbacks.figures().get(f"callback_errors_{kind}", 0)


def test_junk_is_counted_and_what_follows_is_heard(endpoint: str) -> None:
    with Bus.open(endpoint, None, STOP) as bus, Bus.open(endpoint, None, STOP) as stranger:
        ticks, barrier = Ticks(bus), Barrier(bus)
        Claims(("robot_001",), lambda fleet: None).attend(bus)
        stranger.sessions[keys.SIM].liveliness().declare_token(f"{keys.ROOT}/alive/junk")
        for junk in JUNK:
            sim = stranger.sessions[keys.SIM]
            sim.put(keys.TICK, junk)
            sim.put(keys.done_key("x"), junk)
            assert not list(sim.get(keys.CLAIM, payload=junk, timeout=1.0))
        until(lambda: errors(bus, "tick")() == 2 * len(JUNK), "junk ticks are not counted")  # ticks and claims
        until(lambda: errors(bus, "done")() == len(JUNK), "junk answers are not counted")
        until(lambda: errors(bus, "alive")() >= 2, "the junk token is not counted")  # claims and barrier
        assert errors(bus, "claim")() == len(JUNK)
        _assert_still_hears(stranger, ticks, barrier)


def _assert_still_hears(stranger: Bus, ticks: Ticks, barrier: Barrier) -> None:
    token: zenoh.LivelinessToken = stranger.token(keys.LASER, "a", ("robot_001",))
    stranger.tell(keys.done_key("a"), Answer("a", ("laser/robot_001",), -1, {}, 0))
    stranger.tell(keys.TICK, Tick(5, True, False, {}, (), ()))
    until(lambda: barrier.nodes == {"laser/robot_001"}, "the barrier hears no more")
    tick = ticks.next(10.0)
    assert tick is not None and tick.frame == 5
    assert stranger.ask(keys.CLAIM, Claim(keys.NAVIGATOR, "b", 1, ()), Grant, 5.0) is not None
    token.undeclare()


def test_an_answer_that_is_none_is_counted_and_the_next_is_asked(endpoint: str) -> None:
    with ExitStack() as stack:
        bus, rogue, own = (stack.enter_context(Bus.open(endpoint, None, STOP)) for _ in range(3))
        rogue.answer(keys.BRIEFING, lambda: Release())
        own.answer(keys.BRIEFING, lambda: CurrentRun("tiny-001", b"x"))

        def both_heard() -> bool:
            told = bus.ask(keys.BRIEFING, None, CurrentRun, 2.0)
            assert told is None or told.run == "tiny-001"
            return told is not None and errors(bus, "scenario")() > 0

        until(both_heard, "the rogue is not counted, or hides the other")
