"""What a callback raises is counted by kind, said once, and goes no further."""

from __future__ import annotations

import logging
import threading

import pytest
from orograph import keys
from orograph.comms.callbacks import Callbacks
from orograph.runtime import metric_names


def test_errors_are_counted_by_kind_and_said_once(caplog: pytest.LogCaptureFixture) -> None:
    callbacks, heard = Callbacks(), []
    tick = callbacks.guarded("tick", lambda tick: heard.append(tick["frame"]))
    claim = callbacks.guarded("claim", lambda claim: heard.append(claim + 1))
    with caplog.at_level(logging.ERROR):
        for sample in ({}, {"frame": 3}, {}):
            tick(sample)
        claim("nothing")
    assert heard == [3]
    assert callbacks.figures() == {"callback_errors_tick": 2, "callback_errors_claim": 1}
    assert [r.getMessage().split(":")[0].split(" ")[0] for r in caplog.records] == ["tick", "claim"]
    assert "KeyError: 'frame' (test_callbacks.py:" in caplog.text and "Traceback" not in caplog.text


def test_threads_lose_no_count() -> None:
    callbacks = Callbacks()
    call = callbacks.guarded("done", lambda _: 1 / 0)
    threads = [threading.Thread(target=lambda: [call(None) for _ in range(500)]) for _ in range(8)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert callbacks.figures() == {"callback_errors_done": 4000}


def test_every_key_has_a_kind_and_every_kind_its_figure() -> None:
    heard = [keys.TICK, keys.done_key("a"), keys.release_key("a"), keys.ALIVE_ALL, keys.CLAIM, keys.BRIEFING,
             keys.STATUS, keys.REVOKE, keys.telemetry_key(keys.WORLD),
             *keys.inbox_keys(keys.RADIO, keys.WORLD)]  # fmt: skip
    assert {keys.callback_kind(key) for key in heard} == set(keys.CALLBACKS)
    for kind in keys.CALLBACKS:
        placed = metric_names.place(metric_names.PROCESS, f"callback_errors_{kind}")
        assert placed is not None and placed.labels == (("callback", kind),)
