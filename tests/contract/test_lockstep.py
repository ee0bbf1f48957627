"""Lockstep over a real router: the same rounds as in one process, and a participant may die or join."""

import threading
import time
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

import numpy as np
from orograph import keys
from orograph.edge.bus import Bus
from orograph.edge.clock import Clock
from orograph.edge.host import NodeHost
from orograph.edge.participant import Participant, Ticks
from orograph.edge.recording import Recording
from orograph.messages import Drive, Envelope, Frame, RunEnd
from orograph.scenario import Scenario

FRAMES = 40
SCENARIO = Scenario.model_validate(
    {
        "name": "t",
        "title": "t",
        "starts": [{"x_m": 1, "y_m": 1}],
        "robots": 1,
        "base_station_m": [1, 1],
        "patrol": [[2, 2]],
    }
)


class Chatter:
    """Sends a number that depends on everything it has heard, in order; so any disorder shows in the end."""

    def __init__(self, name: str, peers: Sequence[str], plane: str = keys.SIM) -> None:
        self.name, self._peers, self._plane = name, peers, plane
        self.state, self.frames, self.stepped = 1, 0, threading.Event()

    def step(self, frame: Frame, inbox: Sequence[Envelope], send: Callable, note: Callable) -> None:
        for envelope in inbox:
            if isinstance(envelope.message, Drive):
                self.state = (self.state * 31 + envelope.message.stamp_ns * 7 + len(envelope.sender)) % 1_000_003
        for peer in self._peers:
            send(self._plane, peer, Drive(self.state, 0.0, 0.0))
        self.frames += 1
        self.stepped.set()

    def telemetry(self) -> Mapping[str, float]:
        return {"frames": self.frames}

    def artifacts(self) -> Mapping[str, np.ndarray]:
        return {"state": np.array(self.state)}


class Stop:
    def __init__(self) -> None:
        self.stop = threading.Event()

    def alive(self, ready: bool = True) -> None:
        pass


NAMES = [keys.WORLD, keys.MANAGER, keys.ORCHESTRATOR, "navigator/robot_001"]


def _chatters() -> dict[str, Chatter]:
    return {n: Chatter(n, [p for p in NAMES if p != n]) for n in NAMES}


def _in_one_process() -> dict[str, int]:
    chatters = _chatters()
    boxes: dict[str, list[Envelope]] = {n: [] for n in NAMES}
    for k in range(FRAMES):
        sent = [e for name in sorted(NAMES) for e in _sent_by(chatters[name], k, boxes[name])]
        boxes = {n: [e for e in sent if e.to == n] for n in NAMES}
    return {n: c.state for n, c in chatters.items()}


def _sent_by(chatter: Chatter, k: int, inbox: list[Envelope]) -> list[Envelope]:
    sent: list[Envelope] = []
    chatter.step(
        Frame(k, k, 1),
        inbox,
        lambda plane, to, m: sent.append(Envelope(plane, to, chatter.name, k, len(sent), m)),
        lambda *a: None,
    )
    return sent


def _participate(endpoint: str, node: Chatter, guard: Stop, out: Path) -> threading.Thread:
    def run() -> None:
        process = node.name.replace("/", "-")
        with Recording(out, process) as recording, Bus.open(endpoint, None, guard.stop) as bus:
            host = NodeHost(bus, [node], SCENARIO, recording)
            with bus.token("any", node.name.replace("/", "-"), ()):
                Participant(bus, host, node.name.replace("/", "-"), SCENARIO, guard, Ticks(bus)).run()

    thread = threading.Thread(target=run, daemon=True)
    thread.start()
    return thread


def _clock(
    bus: Bus, world: Chatter, guard: Stop, recording: Recording, wanted: Sequence[str], frames: int = FRAMES
) -> Clock:  # fmt: skip
    host = NodeHost(bus, [world], SCENARIO, recording)
    muster = lambda nodes: set(wanted) - nodes  # noqa: E731
    return Clock(
        bus, host, SCENARIO, guard, ended=lambda: world.frames >= frames, down=lambda: (), muster=muster
    )  # fmt: skip


def test_processes_over_zenoh_step_as_one_process_does(endpoint: str, tmp_path: Path) -> None:
    guard, chatters = Stop(), _chatters()
    threads = [_participate(endpoint, chatters[n], guard, tmp_path) for n in NAMES[1:]]
    with Recording(tmp_path, "world") as recording, Bus.open(endpoint, None, guard.stop) as bus:
        clock = _clock(bus, chatters[keys.WORLD], guard, recording, NAMES[1:])
        clock.await_start()
        clock.run()
    for thread in threads:
        thread.join(10)
        assert not thread.is_alive()
    assert clock.lost == 0
    assert {n: c.frames for n, c in chatters.items()} == dict.fromkeys(NAMES, FRAMES)
    assert {n: c.state for n, c in chatters.items()} == _in_one_process()


def test_who_leaves_is_not_waited_for_and_may_come_back(endpoint: str, tmp_path: Path) -> None:
    guard, leaver, chatters = Stop(), Stop(), _chatters()
    stays = _participate(endpoint, chatters[keys.MANAGER], guard, tmp_path)
    leaves = _participate(endpoint, chatters[keys.ORCHESTRATOR], leaver, tmp_path)
    with Recording(tmp_path, "world") as recording, Bus.open(endpoint, None, guard.stop) as bus:
        clock = _clock(bus, chatters[keys.WORLD], guard, recording, NAMES[1:3], frames=10_000_000)
        clock.await_start()
        ticking = threading.Thread(target=clock.run, daemon=True)
        ticking.start()
        assert chatters[keys.ORCHESTRATOR].stepped.wait(10)
        leaver.stop.set()
        leaves.join(10)
        assert not leaves.is_alive()
        _await_progress(chatters[keys.MANAGER])
        back = Chatter(keys.ORCHESTRATOR, [keys.WORLD])
        assert ticking.is_alive()
        again = _participate(endpoint, back, guard, tmp_path)
        assert back.stepped.wait(10)
        _await_progress(chatters[keys.MANAGER])
        guard.stop.set()
        ticking.join(20)
    for thread in (stays, again):
        thread.join(10)
        assert not thread.is_alive()


def _await_progress(chatter: Chatter, frames: int = 20) -> None:
    goal, deadline = chatter.frames + frames, time.monotonic() + 20
    while chatter.frames < goal:
        assert time.monotonic() < deadline, "the clock stands still"
        chatter.stepped.clear()
        chatter.stepped.wait(0.5)


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

    guard, world, ender = Stop(), World(keys.WORLD, []), Ender(keys.ORCHESTRATOR, [])
    thread = _participate(endpoint, ender, guard, tmp_path)
    with Recording(tmp_path, "world") as recording, Bus.open(endpoint, None, guard.stop) as bus:
        host = NodeHost(bus, [world], SCENARIO, recording)
        muster = lambda nodes: {keys.ORCHESTRATOR} - nodes  # noqa: E731
        clock = Clock(
            bus, host, SCENARIO, guard, ended=lambda: world.ended is not None, down=lambda: (), muster=muster
        )  # fmt: skip
        clock.await_start()
        clock.run()
    thread.join(10)
    assert (world.frames, ender.frames, world.ended.complete) == (5, 5, True)
