"""Junk on every control key over a real router: it is counted, and the same session goes on hearing."""

from __future__ import annotations

import threading
from collections.abc import Callable

import zenoh
from orograph import keys
from orograph.comms import wire
from orograph.comms.bus import Bus
from orograph.runtime.barrier import Barrier
from orograph.runtime.claims import Claims
from orograph.runtime.participant import Ticks
from polling import until

STOP = threading.Event()
JUNK = (b"", b"\xc1", wire.pack_plain(7), wire.pack_plain({}), wire.pack_plain([1, 2]))


def errors(bus: Bus, kind: str) -> Callable[[], int]:
    return lambda: bus.callbacks.figures().get(f"callback_errors_{kind}", 0)


def test_junk_is_counted_and_what_follows_is_heard(endpoint: str) -> None:
    with Bus.open(endpoint, None, STOP) as bus, Bus.open(endpoint, None, STOP) as stranger:
        ticks, barrier = Ticks(bus), Barrier(bus)
        Claims(("robot_001",), lambda fleet: None).attend(bus)
        stranger.sessions[keys.SIM].liveliness().declare_token(f"{keys.ROOT}/alive/junk")
        for junk in JUNK:
            stranger.tell(keys.TICK, junk)
            stranger.tell(keys.done_key("x"), junk)
            assert stranger.ask(keys.CLAIM, junk, 1.0) is None
        until(lambda: errors(bus, "tick")() == errors(bus, "done")() == len(JUNK), "junk is not counted")
        until(lambda: errors(bus, "alive")() >= 2, "the junk token is not counted")  # claims and barrier
        assert errors(bus, "claim")() == len(JUNK)
        _assert_still_hears(stranger, ticks, barrier)


def _assert_still_hears(stranger: Bus, ticks: Ticks, barrier: Barrier) -> None:
    token: zenoh.LivelinessToken = stranger.token(keys.LASER, "a", ("robot_001",))
    answer = {"instance": "a", "nodes": ["laser/robot_001"], "frame": -1, "sent": {}, "lost": 0}
    stranger.tell(keys.done_key("a"), wire.pack_plain(answer))
    stranger.tell(keys.TICK, wire.pack_plain({"frame": 5, "end": False}))
    until(lambda: barrier.nodes == {"laser/robot_001"}, "the barrier hears no more")
    tick = ticks.next(10.0)
    assert tick is not None and tick["frame"] == 5
    assert stranger.ask(keys.CLAIM, wire.pack_plain(
        {"service": keys.NAVIGATOR, "instance": "b", "capacity": 1, "wanted": []}), 5.0) is not None  # fmt: skip
    token.undeclare()
