"""The host of nodes tells what was lost on the way to them, once."""

import threading
from collections.abc import Iterable
from pathlib import Path

from orograph import keys
from orograph.comms import wire
from orograph.comms.bus import Bus
from orograph.comms.mailbox import Mailbox
from orograph.messages import Drive, Frame, Message
from orograph.nodes.navigator import NavigatorNode
from orograph.runtime.host import NodeHost
from orograph.scenario import Scenario
from orograph.storage.recording import Recording

NAME = keys.node(keys.NAVIGATOR, "robot_001")


class Unplugged(Bus):
    """A bus without sessions; what it would hear goes into `mailbox` by hand."""

    def listen(self, nodes: Iterable[str], mailbox: Mailbox) -> None:
        self.mailbox = mailbox

    def send(self, sender: str, plane: str, to: str, message: Message) -> None:
        pass

    def show(self, node_name: str, payload: bytes) -> None:
        pass


def test_losses_are_told_in_the_frame_that_finds_them(city_scenario: Scenario, tmp_path: Path) -> None:
    bus = Unplugged({})
    with Recording(tmp_path, "navigator") as recording:
        host = NodeHost(bus, [NavigatorNode(city_scenario, "robot_001", 1)], city_scenario, recording)
        counted = {keys.SIM: {NAME: {keys.WORLD: 1}}}

        def step(index: int) -> int:
            return host.step(Frame(index, index * 10**8, 10**8), counted, frozenset(), True, threading.Event())

        (piece,) = wire.fragments(0, 0, b"not msgpack")
        bus.mailbox.add(keys.message_key(keys.SIM, NAME, "Sensors", keys.WORLD), piece)
        assert step(1) == 1
        (piece,) = wire.fragments(1, 0, wire.encode(Drive(0, 0.0, 0.0)))
        bus.mailbox.add(keys.message_key(keys.SIM, NAME, "Drive", keys.WORLD), piece)
        assert step(2) == 0
