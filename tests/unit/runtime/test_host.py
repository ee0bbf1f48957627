"""The host of nodes tells what was lost on the way to them, and shares its counts with Zenoh's threads."""

import itertools
import json
import threading
from collections.abc import Iterable, Iterator
from pathlib import Path

import pytest
from orograph import keys
from orograph.comms import wire
from orograph.comms.bus import Bus
from orograph.comms.mailbox import Mailbox
from orograph.control import Figures, Tick
from orograph.fields import kinds_of
from orograph.messages import Frame, Message, Sensors
from orograph.nodes.navigator import NavigatorNode
from orograph.runtime.host import NodeHost
from orograph.scenario import Scenario
from orograph.scene.site import Site
from orograph.storage.recording import Recording
from orograph.storage.run_folder import bytes_file

NAME = keys.node(keys.NAVIGATOR, "robot_001")


class Unplugged(Bus):
    """A bus without sessions; what it would hear goes into `mailbox` by hand."""

    def listen(self, nodes: Iterable[str], mailbox: Mailbox) -> None:
        self.mailbox = mailbox

    def send(self, sender: str, plane: str, to: str, message: Message) -> None:
        pass

    def show(self, node_name: str, figures: Figures) -> None:
        pass


@pytest.fixture
def bus() -> Unplugged:
    return Unplugged({})


@pytest.fixture
def host(bus: Unplugged, city_scenario: Scenario, tmp_path: Path) -> Iterator[NodeHost]:
    """Of one navigator."""
    with Recording(tmp_path, "navigator") as recording:
        yield NodeHost(bus, [NavigatorNode(Site(city_scenario), "robot_001", 1)], city_scenario, recording)


def test_losses_are_told_in_the_frame_that_finds_them(bus: Unplugged, host: NodeHost) -> None:
    counted = {keys.stream_name(keys.SIM, NAME, keys.WORLD): 1}

    def step(index: int) -> int:
        return host.step(Frame(index, index * 10**8, 10**8), counted, frozenset(), True, threading.Event())

    (piece,) = wire.fragments(0, 0, b"not msgpack")
    bus.mailbox.add(keys.message_key(keys.SIM, NAME, "Sensors", keys.WORLD), piece)
    assert step(1) == 1
    (piece,) = wire.fragments(1, 0, wire.encode(Sensors(0, 0, *[0.0] * (len(kinds_of(Sensors)) - 2))))
    bus.mailbox.add(keys.message_key(keys.SIM, NAME, "Sensors", keys.WORLD), piece)
    assert step(2) == 0


def test_bytes_may_still_come_while_they_are_saved(
    bus: Unplugged, host: NodeHost, tmp_path: Path, fine_switching: None
) -> None:
    stop = threading.Event()

    def receive() -> None:
        for i in itertools.count():
            if stop.is_set():
                return
            bus.mailbox.bytes_received[keys.RADIO, NAME, str(i)] += 1
            if i % 5_000 == 0:
                bus.mailbox.bytes_received.clear()

    thread = threading.Thread(target=receive)
    thread.start()
    try:
        for _ in range(20):
            host.save({})
    finally:
        stop.set()
        thread.join()
    bus.mailbox.bytes_received[keys.RADIO, NAME, "last"] += 1
    host.save({})
    assert json.loads((tmp_path / bytes_file("navigator")).read_text())["down"]


def test_what_could_not_be_taken_is_noted_once_a_change(bus: Unplugged, host: NodeHost, tmp_path: Path) -> None:
    take = bus.callbacks.guarded("tick", lambda payload: wire.decode(Tick, payload))
    for index, junk in enumerate([b"", b"x", None, b"y"], start=1):
        if junk is not None:
            take(junk)
        host._shown_s = 0.0
        host.step(Frame(index, index * 10**8, 10**8), {}, frozenset(), True, threading.Event())
    events = [json.loads(line) for line in (tmp_path / "parts/events/navigator.jsonl").read_text().splitlines()]
    counts = [event["callback_errors_tick"] for event in events if event["event"] == "control-refused"]
    assert counts == [1, 2, 3]
