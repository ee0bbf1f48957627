"""Nodes that chat in lockstep over a real router, and the same in one process to compare with."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

import numpy as np
from orograph import keys
from orograph.comms.bus import Bus
from orograph.fields import kinds_of
from orograph.messages import POSE, Bodies, Drive, Envelope, Frame, Message, OccupancyGrid, Pose, Scan, Sensors
from orograph.runtime.clock import Clock
from orograph.runtime.host import NodeHost
from orograph.runtime.network import Network
from orograph.runtime.participant import Participant, Ticks
from orograph.runtime.rounds import Rounds
from orograph.scenario import Scenario
from orograph.storage.recording import Recording

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


LASER, MAPPING, NAVIGATOR = (keys.node(service, "robot_001") for service in keys.ROBOT_SERVICES)
NAMES = [keys.WORLD, LASER, MAPPING, NAVIGATOR]
SAYS: dict[str, dict[str, Callable[[int], Message]]] = {
    keys.WORLD: {
        keys.group(keys.LASER): lambda stamp: Bodies(stamp, np.zeros(1, POSE)),
        NAVIGATOR: lambda stamp: Sensors(stamp, 0, *[0.0] * (len(kinds_of(Sensors)) - 2)),
    },
    LASER: {MAPPING: lambda stamp: Scan(stamp, np.zeros((1, 8), "<u2"))},
    MAPPING: {NAVIGATOR: lambda stamp: OccupancyGrid(stamp, 0.0, 0.0, 1.0, True, np.zeros((4, 4), "u1"))},
    NAVIGATOR: {MAPPING: lambda stamp: Pose(stamp, *[0.0] * 7), keys.WORLD: lambda stamp: Drive(stamp, 0.0, 0.0)},
}
"""To whom a node speaks on the sim plane, and how."""


class Chatter:
    """Sends a number that depends on everything it has heard, in order; so any disorder shows in the end."""

    def __init__(self, name: str) -> None:
        self.name = name
        self.state, self.frames, self.goal, self.stepped = 1, 0, FRAMES, threading.Event()

    def step(self, frame: Frame, inbox: Sequence[Envelope], send: Callable, note: Callable) -> None:
        for envelope in inbox:
            self.state = (self.state * 31 + envelope.message.stamp_ns * 7 + len(envelope.sender)) % 1_000_003
        for peer, message in SAYS.get(self.name, {}).items():
            send(keys.SIM, peer, message(self.state))
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


def make_chatters() -> dict[str, Chatter]:
    return {n: Chatter(n) for n in NAMES}


def in_one_process() -> dict[str, int]:
    chatters = make_chatters()
    network = Network(SCENARIO, NAMES, radio_up=dict)
    rounds = Rounds(SCENARIO.frame_ns, list(chatters.values()), network, lambda *note: None)
    for _ in range(FRAMES):
        rounds.step()
    assert not network.refused
    return {n: c.state for n, c in chatters.items()}


def participate(endpoint: str, node: Chatter, watchdog: Stop, out: Path) -> threading.Thread:
    def run() -> None:
        process = node.name.replace("/", "-")
        with Recording(out, process) as recording, Bus.open(endpoint, None, watchdog.stop) as bus:
            host = NodeHost(bus, [node], SCENARIO, recording)
            with bus.token("any", node.name.replace("/", "-"), ()):
                Participant(bus, host, node.name.replace("/", "-"), SCENARIO, watchdog, Ticks(bus)).run()

    thread = threading.Thread(target=run, daemon=True)
    thread.start()
    return thread


def make_clock(
    bus: Bus, world: Chatter, watchdog: Stop, recording: Recording, wanted: Sequence[str], scenario: Scenario = SCENARIO
) -> Clock:  # fmt: skip
    host = NodeHost(bus, [world], scenario, recording)
    roster = lambda nodes: set(wanted) - nodes  # noqa: E731
    return Clock(
        bus, host, scenario, watchdog, ended=lambda: world.frames >= world.goal, down=lambda: (), roster=roster
    )  # fmt: skip


def assert_steps_as_one_process(where: Mapping[str, str], out: Path) -> None:
    """All of NAMES in lockstep, each on a bus to its endpoint, come to what they come to in one process."""
    watchdog, chatters = Stop(), make_chatters()
    threads = [participate(where[n], chatters[n], watchdog, out) for n in NAMES[1:]]
    with Recording(out, "world") as recording, Bus.open(where[keys.WORLD], None, watchdog.stop) as bus:
        clock = make_clock(bus, chatters[keys.WORLD], watchdog, recording, NAMES[1:])
        clock.await_start()
        clock.run()
    for thread in threads:
        thread.join(10)
        assert not thread.is_alive()
    assert clock.lost == 0 and clock.deterministic
    assert {n: c.frames for n, c in chatters.items()} == dict.fromkeys(NAMES, FRAMES)
    assert {n: c.state for n, c in chatters.items()} == in_one_process()


def await_progress(chatter: Chatter, frames: int = 20) -> None:
    goal, deadline = chatter.frames + frames, time.monotonic() + 20
    while chatter.frames < goal:
        assert time.monotonic() < deadline, "the clock stands still"
        chatter.stepped.clear()
        chatter.stepped.wait(0.5)
