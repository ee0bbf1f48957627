"""Steps the nodes of one process through the frames: inbox from the mailbox, radio model, sends over the bus."""

from __future__ import annotations

import threading
import time
from collections.abc import Mapping, Sequence
from pathlib import Path

from orograph import keys
from orograph.comms.bus import Bus
from orograph.comms.mailbox import Mailbox, streams_to
from orograph.control import Figures
from orograph.messages import Envelope, Frame
from orograph.node import Node
from orograph.radio import delivers
from orograph.runtime import metrics
from orograph.scenario import Scenario
from orograph.stages import StageRecorder
from orograph.storage.recording import Recording

SHOW_EVERY_S = 0.5


class NodeHost:
    """Nodes that share a process. `step` is one frame of all of them, in the order of their names."""

    def __init__(self, bus: Bus, nodes: Sequence[Node], scenario: Scenario, recording: Recording) -> None:
        self.nodes = sorted(nodes, key=lambda n: n.name)
        self._bus, self._scenario, self._recording = bus, scenario, recording
        self._mailbox = Mailbox(scenario.robot_ids)
        self._lost, self._shown_s = 0, 0.0
        self._refused: dict[str, int] = {}
        bus.listen([n.name for n in self.nodes], self._mailbox)

    @metrics.STEP.time()
    def step(
        self, frame: Frame, counted: Mapping[str, int], down: frozenset[str], lockstep: bool, stop: threading.Event
    ) -> int:
        """Step every node with what was sent before this frame; returns how many messages were lost on the way.

        `counted` are the messages of the frame before by stream, `down` the robots without radio in that frame.
        """
        if lockstep:
            needed = streams_to((n.name for n in self.nodes), counted)
            with metrics.WAIT.time():
                self._mailbox.await_counted(frame.index - 1, needed, stop)
        inbox = self._mailbox.take(frame.index, newest_only=not lockstep)
        self._bus.begin(frame.index)
        for node in self.nodes:
            self._step_node(node, frame, [e for e in inbox if self._reaches(node.name, e, down)])
        self._show(frame)
        lost, self._lost = self._mailbox.lost - self._lost, self._mailbox.lost
        return lost

    def _step_node(self, node: Node, frame: Frame, inbox: list[Envelope]) -> None:
        node.step(
            frame,
            inbox,
            lambda plane, to, message: self._bus.send(node.name, plane, to, message),
            lambda kind, fields: self._recording.note(frame.stamp_ns, node.name, kind, fields),
        )

    def _reaches(self, name: str, envelope: Envelope, down: frozenset[str]) -> bool:
        if envelope.to not in (name, keys.group(keys.split(name)[0])):
            return False
        if envelope.plane == keys.SIM:
            return True
        up = dict.fromkeys(down, False)
        loss = self._scenario.radio.loss
        return delivers(self._scenario.seed, loss, up, envelope.sender, name, envelope.frame, envelope.index)

    def _show(self, frame: Frame) -> None:
        now = time.monotonic()
        if now - self._shown_s < SHOW_EVERY_S:
            return
        self._shown_s = now
        shown = {node.name: node.telemetry() for node in self.nodes}
        process = metrics.process_figures(frame.stamp_ns, self._scenario, shown, self._mailbox, self._bus)
        memory = {"rss_max_bytes": rss_max_bytes()}
        metrics.FIGURES.show(shown, {**process, **memory})
        self._note_refused(frame)
        for name, telemetry in shown.items():
            figures = {**telemetry, **self._counts(), **memory}
            self._bus.show(name, Figures({k: float(v) for k, v in figures.items()}))

    def _note_refused(self, frame: Frame) -> None:
        """Control messages that could not be taken, when there are more than were noted."""
        if (refused := self._bus.callbacks.figures()) != self._refused:
            self._refused = refused
            self._recording.note(frame.stamp_ns, self.nodes[0].name, "control-refused", refused)

    def save(self, stages: Mapping[str, StageRecorder]) -> None:
        """Leave everything in the run folder."""
        for node in self.nodes:
            self._recording.save(node)
        for name, recorder in stages.items():
            self._recording.save_stages(name, recorder)
        self._recording.save_bytes(*self._bytes_by_robot())
        figures = {"nodes": [n.name for n in self.nodes], "rss_max_bytes": rss_max_bytes(), **self._counts()}
        self._recording.save_figures(figures)

    def _counts(self) -> dict[str, int]:
        return {**self._mailbox.counts, **self._bus.callbacks.figures()}

    def _bytes_by_robot(self) -> tuple[dict[str, int], dict[str, int]]:
        """Radio bytes by robot, up as sent and down as received by that robot's services in this process."""
        up: dict[str, int] = {}
        down: dict[str, int] = {}
        for (plane, _, sender), n in self._bus.bytes_sent.items():
            if plane == keys.RADIO and (robot := keys.split(sender)[1]):
                up[robot] = up.get(robot, 0) + n
        for (plane, to, _), n in dict(self._mailbox.bytes_received).items():  # Zenoh's threads count on
            if plane == keys.RADIO:
                for robot in self._robots_at(to):
                    down[robot] = down.get(robot, 0) + n
        return up, down

    def _robots_at(self, to: str) -> list[str]:
        service, robot = keys.split(to)
        held = [keys.split(n.name) for n in self.nodes]
        return sorted({r for s, r in held if r and s == service and robot in (r, "*")})


def rss_max_bytes() -> int:
    """This process's own peak resident memory: getrusage would count what its parent had before exec."""
    status = Path("/proc/self/status").read_text()
    return int(status.split("VmHWM:")[1].split()[0]) * 1024
