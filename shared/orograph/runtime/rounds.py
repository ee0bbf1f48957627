"""A whole mission in one process: the same step objects over the seeded radio model, one synchronous round a frame."""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Callable, Mapping, Sequence
from typing import Any

from orograph import keys
from orograph.messages import Envelope, Frame, Message
from orograph.node import Node
from orograph.nodes.world import WorldNode
from orograph.radio import delivers
from orograph.scenario import Scenario

RecordNote = Callable[[int, str, str, Mapping[str, Any]], None]


class Rounds:
    """Steps all nodes frame by frame; `size_bytes` weighs radio messages, `note` records events."""

    def __init__(
        self, scenario: Scenario, world: WorldNode, nodes: Sequence[Node],
        size_bytes: Callable[[Message], int], note: RecordNote,
    ) -> None:  # fmt: skip
        self._scenario, self._world = scenario, world
        self.nodes: list[Node] = sorted([world, *nodes], key=lambda n: n.name)
        self._size_bytes, self._note = size_bytes, note
        self._boxes: dict[str, list[Envelope]] = {n.name: [] for n in self.nodes}
        self.frame = -1
        self.bytes_up: Counter[str] = Counter()
        self.bytes_down: Counter[str] = Counter()

    @property
    def stamp_ns(self) -> int:
        """Simulation time of the newest frame."""
        return max(self.frame, 0) * self._scenario.frame_ns

    def step(self) -> None:
        """One frame: every node once, then the radio decides what arrives for the next."""
        self.frame += 1
        frame = Frame(self.frame, self.stamp_ns, self._scenario.frame_ns)
        sent: list[Envelope] = []
        for node in self.nodes:
            self._step_node(node, frame, sent)
        self._deliver(sent)

    def _step_node(self, node: Node, frame: Frame, sent: list[Envelope]) -> None:
        inbox, self._boxes[node.name] = self._boxes[node.name], []
        first = len(sent)

        def send(plane: str, to: str, message: Message) -> None:
            sent.append(Envelope(plane, to, node.name, frame.index, len(sent) - first, message))

        node.step(frame, inbox, send, lambda kind, fields: self._note(frame.stamp_ns, node.name, kind, fields))

    def _deliver(self, sent: Sequence[Envelope]) -> None:
        up = self._world.radio_up()
        groups: defaultdict[str, list[str]] = defaultdict(list)
        for name in self._boxes:
            groups[keys.group(keys.split(name)[0])].append(name)
            groups[name].append(name)
        # Nodes step in the order of their names and number their messages, so `sent` is ordered by (sender, index).
        for envelope in sent:
            receivers = groups[envelope.to]
            if envelope.plane == keys.RADIO:
                self._weigh(envelope, receivers)
                receivers = [r for r in receivers if self._reaches(envelope, r, up)]
            for receiver in receivers:
                self._boxes[receiver].append(envelope)

    def _reaches(self, e: Envelope, receiver: str, up: Mapping[str, bool]) -> bool:
        return delivers(self._scenario.seed, self._scenario.radio.loss, up, e.sender, receiver, e.frame, e.index)

    def _weigh(self, envelope: Envelope, receivers: Sequence[str]) -> None:
        size = self._size_bytes(envelope.message)
        if robot := keys.split(envelope.sender)[1]:
            self.bytes_up[robot] += size
        for receiver in receivers:
            if robot := keys.split(receiver)[1]:
                self.bytes_down[robot] += size
