"""A whole mission in one process: the same step objects over the seeded network, one synchronous round a frame."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

from orograph.messages import Envelope, Frame, Message
from orograph.node import Node
from orograph.runtime.network import Network

RecordNote = Callable[[int, str, str, Mapping[str, Any]], None]


class Rounds:
    """Steps all nodes frame by frame over `network`; `note` records events."""

    def __init__(self, frame_ns: int, nodes: Sequence[Node], network: Network, note: RecordNote) -> None:
        self._frame_ns, self._note = frame_ns, note
        self.network = network
        self.nodes: list[Node] = sorted(nodes, key=lambda n: n.name)
        """In the order in which they step; a node may be put in another's place between two frames."""
        self.frame = -1

    @property
    def stamp_ns(self) -> int:
        """Simulation time of the newest frame."""
        return max(self.frame, 0) * self._frame_ns

    def step(self) -> None:
        """One frame: every node once, then the network decides what arrives for the next."""
        self.frame += 1
        frame = Frame(self.frame, self.stamp_ns, self._frame_ns)
        inboxes = {name: self.network.arrived(name, self.frame) for name in {node.name for node in self.nodes}}
        sent: list[Envelope] = []
        for node in self.nodes:
            self._step_node(node, frame, inboxes[node.name], sent)
        # Nodes step in the order of their names and number their messages, so `sent` is ordered by (sender, index).
        self.network.carry(self.frame, sent)

    def _step_node(self, node: Node, frame: Frame, inbox: Sequence[Envelope], sent: list[Envelope]) -> None:
        first = len(sent)

        def send(plane: str, to: str, message: Message) -> None:
            sent.append(Envelope(plane, to, node.name, frame.index, len(sent) - first, message))

        node.step(frame, inbox, send, lambda kind, fields: self._note(frame.stamp_ns, node.name, kind, fields))
