"""Lockstep over a real router: the same rounds as in one process, and a participant may die or join."""

import sys
import threading
from collections.abc import Callable, Sequence
from pathlib import Path

import pytest
from contract.chatter import (
    LASER,
    MAPPING,
    NAMES,
    SCENARIO,
    Chatter,
    Stop,
    assert_steps_as_one_process,
    await_progress,
    make_chatters,
    make_clock,
    participate,
)  # fmt: skip
from orograph import keys
from orograph.comms.bus import Bus
from orograph.messages import Envelope, Frame, RunEnd
from orograph.runtime.clock import Clock
from orograph.runtime.host import NodeHost
from orograph.storage.recording import Recording


def test_processes_over_zenoh_step_as_one_process_does(endpoint: str, tmp_path: Path) -> None:
    assert_steps_as_one_process(dict.fromkeys(NAMES, endpoint), tmp_path)


@pytest.mark.parametrize("comes_back", [False, True])
def test_who_leaves_is_not_waited_for_and_may_come_back(endpoint: str, tmp_path: Path, comes_back: bool) -> None:
    watchdog, leaver, chatters = Stop(), Stop(), make_chatters()
    chatters[keys.WORLD].goal = sys.maxsize
    stays = participate(endpoint, chatters[LASER], watchdog, tmp_path)
    leaves = participate(endpoint, chatters[MAPPING], leaver, tmp_path)
    with Recording(tmp_path, "world") as recording, Bus.open(endpoint, None, watchdog.stop) as bus:
        clock = make_clock(bus, chatters[keys.WORLD], watchdog, recording, NAMES[1:3])
        clock.await_start()
        ticking = threading.Thread(target=clock.run, daemon=True)
        ticking.start()
        assert chatters[MAPPING].stepped.wait(10)
        leaver.stop.set()
        leaves.join(10)
        assert not leaves.is_alive()
        await_progress(chatters[LASER])
        assert ticking.is_alive()
        threads = [stays, *([come_back(endpoint, watchdog, tmp_path)] if comes_back else [])]
        await_progress(chatters[LASER])
        chatters[keys.WORLD].goal = 0
        ticking.join(20)
    for thread in threads:
        thread.join(10)
        assert not thread.is_alive()
    assert not clock.deterministic


def come_back(endpoint: str, watchdog: Stop, out: Path) -> threading.Thread:
    back = Chatter(MAPPING)
    thread = participate(endpoint, back, watchdog, out)
    assert back.stepped.wait(10)
    return thread


@pytest.mark.parametrize(("pace", "is_stopped"), [(100.0, False), ("max", True)])
def test_a_paced_or_stopped_run_promises_no_map(
    endpoint: str, tmp_path: Path, pace: float | str, is_stopped: bool
) -> None:  # fmt: skip
    watchdog, world, manager = Stop(), Chatter(keys.WORLD), Chatter(keys.MANAGER)
    thread = participate(endpoint, manager, watchdog, tmp_path)
    with Recording(tmp_path, "world") as recording, Bus.open(endpoint, None, watchdog.stop) as bus:
        scenario = SCENARIO.model_copy(update={"time_scale": pace})
        clock = make_clock(bus, world, watchdog, recording, [keys.MANAGER], scenario)
        clock.await_start()
        if is_stopped:
            watchdog.stop.set()
        clock.run()
    thread.join(10)
    assert not clock.deterministic


def test_the_end_reaches_the_world_as_a_message(endpoint: str, tmp_path: Path) -> None:
    class Ender(Chatter):
        def step(self, frame: Frame, inbox: Sequence[Envelope], send: Callable, note: Callable) -> None:
            self.frames += 1
            if frame.index == 3:
                send(keys.SIM, keys.WORLD, RunEnd(True, True))

    class World(Chatter):
        ended = None

        def step(self, frame: Frame, inbox: Sequence[Envelope], send: Callable, note: Callable) -> None:
            self.frames += 1
            self.ended = next((e.message for e in inbox if isinstance(e.message, RunEnd)), None)

    watchdog, world, ender = Stop(), World(keys.WORLD), Ender(keys.ORCHESTRATOR)
    thread = participate(endpoint, ender, watchdog, tmp_path)
    with Recording(tmp_path, "world") as recording, Bus.open(endpoint, None, watchdog.stop) as bus:
        host = NodeHost(bus, [world], SCENARIO, recording)
        roster = lambda nodes: {keys.ORCHESTRATOR} - nodes  # noqa: E731
        clock = Clock(
            bus, host, SCENARIO, watchdog, ended=lambda: world.ended is not None, down=lambda: (), roster=roster
        )  # fmt: skip
        clock.await_start()
        clock.run()
    thread.join(10)
    assert (world.frames, ender.frames, world.ended.complete) == (5, 5, True)
