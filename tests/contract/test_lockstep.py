"""Lockstep over a real router: the same rounds as in one process, and a participant may die or join."""

import threading
from collections.abc import Callable, Sequence
from pathlib import Path

from contract.chatter import (
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


def test_who_leaves_is_not_waited_for_and_may_come_back(endpoint: str, tmp_path: Path) -> None:
    watchdog, leaver, chatters = Stop(), Stop(), make_chatters()
    stays = participate(endpoint, chatters[keys.MANAGER], watchdog, tmp_path)
    leaves = participate(endpoint, chatters[keys.ORCHESTRATOR], leaver, tmp_path)
    with Recording(tmp_path, "world") as recording, Bus.open(endpoint, None, watchdog.stop) as bus:
        clock = make_clock(bus, chatters[keys.WORLD], watchdog, recording, NAMES[1:3], frames=10_000_000)
        clock.await_start()
        ticking = threading.Thread(target=clock.run, daemon=True)
        ticking.start()
        assert chatters[keys.ORCHESTRATOR].stepped.wait(10)
        leaver.stop.set()
        leaves.join(10)
        assert not leaves.is_alive()
        await_progress(chatters[keys.MANAGER])
        back = Chatter(keys.ORCHESTRATOR, [keys.WORLD])
        assert ticking.is_alive()
        again = participate(endpoint, back, watchdog, tmp_path)
        assert back.stepped.wait(10)
        await_progress(chatters[keys.MANAGER])
        watchdog.stop.set()
        ticking.join(20)
    for thread in (stays, again):
        thread.join(10)
        assert not thread.is_alive()


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

    watchdog, world, ender = Stop(), World(keys.WORLD, []), Ender(keys.ORCHESTRATOR, [])
    thread = participate(endpoint, ender, watchdog, tmp_path)
    with Recording(tmp_path, "world") as recording, Bus.open(endpoint, None, watchdog.stop) as bus:
        host = NodeHost(bus, [world], SCENARIO, recording)
        muster = lambda nodes: {keys.ORCHESTRATOR} - nodes  # noqa: E731
        clock = Clock(
            bus, host, SCENARIO, watchdog, ended=lambda: world.ended is not None, down=lambda: (), muster=muster
        )  # fmt: skip
        clock.await_start()
        clock.run()
    thread.join(10)
    assert (world.frames, ender.frames, world.ended.complete) == (5, 5, True)
