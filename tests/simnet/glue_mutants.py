"""Broken glue: nodes that do one thing wrong between the protocol, the mapper and the mission."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import replace

from orograph import keys
from orograph.messages import Phase
from orograph.nodes.map_manager import MapManagerNode
from orograph.nodes.orchestrator import OrchestratorNode
from orograph.nodes.robot_mapping import RobotMappingNode
from orograph.protocol.store import StoreFailed


class FlushesNothing(RobotMappingNode):
    """Says that it has flushed when the outbox is empty, whatever the mapper still has."""

    def _flush(self, note):
        self._flushed = self._sync.flushed


class HearsNoFlush(RobotMappingNode):
    def _sort(self, inbox):
        return super()._sort([envelope for envelope in inbox if not isinstance(envelope.message, Phase)])


class MapsOnInTheFlush(RobotMappingNode):
    def _map(self, scan, pose):
        flushing, self._flushing = self._flushing, False
        super()._map(scan, pose)
        self._flushing = flushing


class AdoptsItsRowTwice(RobotMappingNode):
    def _adopt(self, row, first_life):
        super()._adopt(row, first_life)
        super()._adopt(row, first_life)


class AdoptsNoRow(RobotMappingNode):
    """The outbox takes the row over, the mapper does not."""

    def _adopt(self, row, first_life):
        return


class AdoptsWithoutFusing(RobotMappingNode):
    def _adopt(self, row, first_life):
        super()._adopt(row, False)


class FlushesByTheThresholds(RobotMappingNode):
    """What moved by less than the thresholds is not sent in the flush either."""

    def _flush(self, note):
        self._offer(self._mapper.registers())
        self._flushed = self._sync.flushed


class PairsAScanWithAnyPose(RobotMappingNode):
    """Maps a scan at once, from where the robot was last known to be."""

    def __init__(self, *args, **kwargs):
        super().__init__(*args, **kwargs)
        arrivals = self._arrivals

        def pairs(now_ns):
            ready = [
                (scan, next(reversed(arrivals._poses.values()))) for scan in arrivals._scans.values() if arrivals._poses
            ]
            arrivals._scans.clear()
            return ready

        arrivals.pairs = pairs


class AnswersEverybody(MapManagerNode):
    """What is for one robot goes to all of them."""

    def step(self, frame, inbox, send, note):
        def to_all(plane, to, message):
            send(plane, keys.group(keys.MAPPING) if keys.split(to)[0] == keys.MAPPING else to, message)

        super().step(frame, inbox, to_all, note)


class TakesAllForTheFirstRobot(MapManagerNode):
    def step(self, frame, inbox, send, note):
        first = keys.node(keys.MAPPING, self._robots[0])
        super().step(frame, [replace(envelope, sender=first) for envelope in inbox], send, note)


class GoesOnAfterAFailedSync(MapManagerNode):
    def step(self, frame, inbox, send, note):
        with suppress(StoreFailed):
            super().step(frame, inbox, send, note)


class EndsWithoutAgreement(OrchestratorNode):
    def __init__(self, *args, **kwargs):
        super().__init__(*args, **kwargs)
        self._phases.agreed = lambda: True


class SaysThePhaseOnce(OrchestratorNode):
    _said = ""

    def _speak(self, patrol, send):
        def once(plane, to, message):
            if not isinstance(message, Phase) or message.name != self._said:
                send(plane, to, message)
            self._said = message.name if isinstance(message, Phase) else self._said

        super()._speak(patrol, once)


class ForgetsTheFlushOverARestart(OrchestratorNode):
    """A robot's report of its flush counts for ever, whatever it says later."""

    def __init__(self, *args, **kwargs):
        super().__init__(*args, **kwargs)
        self._phases.hear_mapping = self._believe
        self._phases.agreed = lambda: all(self._phases._agreements.values())

    def _believe(self, robot, status):
        self._phases._agreements[robot] |= status.flushed


GLUE = (
    FlushesNothing, HearsNoFlush, MapsOnInTheFlush, AdoptsItsRowTwice, AdoptsNoRow, AdoptsWithoutFusing,
    FlushesByTheThresholds, PairsAScanWithAnyPose, AnswersEverybody, TakesAllForTheFirstRobot, GoesOnAfterAFailedSync,
    EndsWithoutAgreement, SaysThePhaseOnce, ForgetsTheFlushOverARestart,
)  # fmt: skip
