"""Broken robots and managers, each with one mistake that the checkers must catch: they prove that the checkers see."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from orograph.messages import REGISTER, U4, UPDATE, Batch, Delta, Welcome
from orograph.protocol.copy import GlrmCopy
from orograph.protocol.manager import ManagerSync, _Intake
from orograph.protocol.robot import RobotSync
from orograph.protocol.store import Changes, Granted

TWINS = [seed for seed in range(7, 700, 7) if seed % 3 and seed % 5 != 4]
"""Storms in which two containers claim one id: what only they show is looked for there."""
LOST_DISKS = range(4, 500, 5)
"""Storms in which the manager loses its disk."""

# --- managers --------------------------------------------------------------------------------------------------------


class AckBeforeCommit(ManagerSync):
    def _keep_and_answer(self, intake, now_ns, send):
        for robot, batches in intake.batches.items():
            for batch in batches:
                send(robot, _ack_of(batch))
        super()._keep_and_answer(intake, now_ns, send)


class AckThoughDiskIsFull(ManagerSync):
    def _commit(self, changes):
        super()._commit(changes)
        return True


class PublishBeforeCommit(ManagerSync):
    def _commit(self, changes):
        if changes.registers:
            cells = np.unique(np.concatenate([rows["cell"] for rows in changes.registers.values()])).astype(np.int64)
            folded = self._ledger.folded(cells, changes.registers)
            folded["version"] = changes.version
            for to in self._numbers:
                self._send_early(to, Delta(self.manager_epoch, self.version, changes.version, 0, 1, False, folded))
        return super()._commit(changes)

    def step(self, now_ns, inbox, send, *note):
        self._send_early = send
        super().step(now_ns, inbox, send, *note)


class NoSequenceCheck(ManagerSync):
    def __init__(self, *args, **kwargs):
        super().__init__(*args, **kwargs)
        self._ledger.news = lambda robot, rows: rows[np.unique(rows["cell"], return_index=True)[1]]


class NoEpochCheck(ManagerSync):
    seeds = TWINS

    def _take_batch(self, intake, robot, batch):
        intake.batches[robot].append(batch)


class BelievesAnything(ManagerSync):
    """Takes what it is sent without a look at it (as far as it fits into the map at all)."""

    def _take_in(self, now_ns, inbox):
        intake = _Intake()
        for robot, message in inbox:
            if not isinstance(message, Batch) or (message.records["cell"] < self._size).all():
                self._sort(intake, robot, message)
        return intake


class NewEpochForEveryHello(ManagerSync):
    def _take_hello(self, intake, robot, nonce):
        number = self._numbers[robot]
        if any(grant.robot == number for grant in intake.granted):
            return
        intake.hellos.append((robot, nonce))
        intake.granted.append(Granted(number, nonce, self._epochs.current(number) + 1))


class EpochsInMemoryOnly(ManagerSync):
    def _commit(self, changes):
        return super()._commit(replace(changes, granted=()))


class WelcomeWithoutTheRow(ManagerSync):
    def _answer(self, intake, send):
        row, self._ledger.row = self._ledger.row, lambda robot: np.zeros(0, REGISTER)
        super()._answer(intake, send)
        self._ledger.row = row


class FoldInOrderOfArrival(ManagerSync):
    """Fuses what comes into the map as it is, as the paper's Map Manager would."""

    def __init__(self, *args, **kwargs):
        super().__init__(*args, **kwargs)
        ledger, folded = self._ledger, self._ledger.folded

        def onto_the_map(cells, news):
            if not hasattr(ledger, "glrm"):
                return folded(cells, news)
            prior, rows = ledger.prior, ledger._rows
            ledger.prior, ledger._rows = ledger.glrm, {}
            out = folded(cells, news)
            ledger.prior, ledger._rows = prior, rows
            return out

        ledger.folded = onto_the_map


class VersionsStartAgain(ManagerSync):
    """After a restart versions begin at 0 in the same manager epoch."""

    def __init__(self, *args, **kwargs):
        super().__init__(*args, **kwargs)
        self.manager_epoch, self.version = 1, 0
        self._downlink._epoch, self._downlink.version, self._downlink._published = 1, 0, 0


class EpochsBeginAgain(ManagerSync):
    """Counts its lives and the robots' epochs from 1 in every new store."""

    seeds = LOST_DISKS

    def __init__(self, *args, **kwargs):
        super().__init__(*args, **{**kwargs, "draw": 0})


class StoreForgotten(ManagerSync):
    """Recovers the registers of the first robot only."""

    def __init__(self, shape, prior, rules, store, robots, **kwargs):
        held = store.load()
        kept = {robot: rows for robot, rows in held.registers.items() if robot == 1}
        super().__init__(shape, prior, rules, _Shown(store, replace(held, registers=kept)), robots, **kwargs)


class _Shown:
    def __init__(self, store, held):
        self._store, self._held = store, held

    def load(self):
        return self._held

    def commit(self, changes: Changes) -> None:
        self._store.commit(changes)


class RepairLeavesCellsOut(ManagerSync):
    """Answers "since version" with half of the cells, and says it is all."""

    def __init__(self, *args, **kwargs):
        super().__init__(*args, **kwargs)
        parts = self._downlink._delta_parts
        self._downlink._delta_parts = lambda first, last, cells, repair: parts(
            first, last, cells[::2] if repair else cells, repair
        )


# --- robots ----------------------------------------------------------------------------------------------------------


class _WithCopy(RobotSync):
    copy_class: type[GlrmCopy] = GlrmCopy

    def __init__(self, robot, shape, prior, nonce, seed, limits):
        super().__init__(robot, shape, prior, nonce, seed, limits)
        self.copy = self.copy_class(shape, prior)


class _OverGaps(GlrmCopy):
    def _take_beat(self, beat):
        self._apply(replace(beat, first_version=min(beat.first_version, self.version)))


class DeltaOverAGap(_WithCopy):
    copy_class = _OverGaps


class _OldCellsWin(GlrmCopy):
    def take_delta(self, delta):
        if self._followed(delta.manager_epoch):
            self.cells["version"] = 0
            (self._apply if delta.last_version <= self.version else super().take_delta)(delta)


class LateDeltaOverwrites(_WithCopy):
    copy_class = _OldCellsWin


class _PartIsWhole(GlrmCopy):
    def _complete(self, delta):
        return delta.part == 0


class FirstPartIsEnough(_WithCopy):
    copy_class = _PartIsWhole


class _Deaf(GlrmCopy):
    def take_digest(self, digest):
        return


class IgnoresDigests(_WithCopy):
    copy_class = _Deaf


class _FollowsAnybody(GlrmCopy):
    def _followed(self, manager_epoch):
        if manager_epoch != self.manager_epoch:
            self._follow(manager_epoch)
        return True


class FollowsAnyLife(_WithCopy):
    """Takes the first word of another life of the manager for its truth, whoever says it."""

    copy_class = _FollowsAnybody


class _FollowsLater(GlrmCopy):
    def _followed(self, manager_epoch):
        if manager_epoch > self.manager_epoch:
            self._follow(manager_epoch)
        return manager_epoch == self.manager_epoch


class IgnoresLowerLives(_WithCopy):
    """Holds a manager epoch that is lower than the greatest heard for the past."""

    copy_class = _FollowsLater


class NeverAsksAgain(RobotSync):
    """Believes that every life of the manager holds what an earlier one acknowledged."""

    seeds = LOST_DISKS

    def step(self, now_ns, inbox, send):
        self._joining.follow = lambda manager_epoch: None
        return super().step(now_ns, inbox, send)


class GivesUpAfterOneAck(RobotSync):
    """Takes any ack of a higher epoch as proof that another instance has this robot."""

    def _take_ack(self, ack, now_ns):
        if ack.epoch > (self.epoch or U4):
            self._joining._stop(now_ns)
            self._joining.superseded = True
        return super()._take_ack(ack, now_ns)


class ForgetsItsRow(RobotSync):
    """After a restart it begins from nothing, and its little evidence replaces its much."""

    def _begin_epoch(self, row):
        return super()._begin_epoch(row[:0])


class LocalEvidenceOverRow(RobotSync):
    """In its first life it sends what it saw since the start over what the manager holds, without fusing."""

    def _begin_epoch(self, row):
        self._outbox.rebase(row, first_life=False)
        return row


class ForgetsDirtyCells(RobotSync):
    """On a new epoch it takes all it has as sent."""

    def _begin_epoch(self, row):
        adopted = super()._begin_epoch(row)
        self._outbox._dirty[:] = False
        self._outbox._count()
        return adopted

    def offer(self, records):
        seen = self._outbox.own["confidence"][records["cell"]] > 0
        same = self._outbox.own["tick"][records["cell"]] == records["tick"]
        super().offer(records[~(seen & same)])


class SentIsAcked(RobotSync):
    """Clears cells when they are sent: at most once."""

    def step(self, now_ns, inbox, send):
        sent = [np.zeros(0, UPDATE)]

        def keep(message):
            send(message)
            if isinstance(message, Batch):
                sent.append(message.records)

        result = super().step(now_ns, inbox, keep)
        gone = np.concatenate(sent)
        self._outbox.acknowledge(gone["cell"], gone["seq"], self.epoch or 0)
        return result


class AckClearsWhateverSeq(RobotSync):
    def _take_ack(self, ack, now_ns):
        if self._joining.hear_ack_of(ack.epoch, now_ns):
            self._outbox.acknowledge(ack.acked["cell"], self._outbox.own["seq"][ack.acked["cell"]], ack.epoch)


class EchoesTheMap(RobotSync):
    """Sends what it was told as its own evidence."""

    def step(self, now_ns, inbox, send):
        result = super().step(now_ns, inbox, send)
        for message in inbox:
            if isinstance(message, Delta) and len(message.cells):
                told = np.zeros(len(message.cells), UPDATE)
                for name in ("cell", "height", "gradient_x", "gradient_y", "occupation", "confidence"):
                    told[name] = message.cells[name]
                told["tick"] = now_ns // 1_000_000
                self.offer(told[told["confidence"] > 32])
        return result


class FencedFightsBack(RobotSync):
    """Says hello again at once, so that two with one id take turns for ever."""

    seeds = TWINS

    def step(self, now_ns, inbox, send):
        self._joining.superseded = False
        self._joining._hello_again_ns = 0
        return super().step(now_ns, inbox, send)


class SameNonceAfterRestart(RobotSync):
    """Every instance of a robot introduces itself by one name: the manager cannot tell two lives apart."""

    def __init__(self, robot, shape, prior, nonce, seed, limits):
        super().__init__(robot, shape, prior, robot.encode().ljust(16), seed, limits)


class TakesAnyWelcome(RobotSync):
    """Takes a welcome for another instance as its own."""

    seeds = TWINS

    def step(self, now_ns, inbox, send):
        mine = self._joining._nonce
        inbox = [replace(m, nonce=mine) if isinstance(m, Welcome) else m for m in inbox]
        return super().step(now_ns, inbox, send)


class UnboundedFlight(RobotSync):
    """Sends everything at once, for ever."""

    def _send_batches(self, epoch, now_ns, send):
        for _ in range(3):
            flights, self._outbox._flights = self._outbox._flights, []
            self._outbox._in_flight[:] = False
            records = self._outbox.next_batch(now_ns)
            self._outbox._flights += flights
            if len(records):
                send(Batch(epoch, records))


def _ack_of(batch):
    from orograph.protocol.manager import _ack

    return _ack(batch)


PROTOCOL = (
    AckBeforeCommit, AckThoughDiskIsFull, PublishBeforeCommit, NoSequenceCheck, NoEpochCheck, BelievesAnything,
    NewEpochForEveryHello, EpochsInMemoryOnly, WelcomeWithoutTheRow, FoldInOrderOfArrival, VersionsStartAgain,
    EpochsBeginAgain, StoreForgotten, RepairLeavesCellsOut,
    DeltaOverAGap, LateDeltaOverwrites, FirstPartIsEnough, IgnoresDigests, ForgetsItsRow, LocalEvidenceOverRow,
    ForgetsDirtyCells, SentIsAcked, AckClearsWhateverSeq, EchoesTheMap, FencedFightsBack, SameNonceAfterRestart,
    TakesAnyWelcome, UnboundedFlight, FollowsAnyLife, IgnoresLowerLives, NeverAsksAgain, GivesUpAfterOneAck,
)  # fmt: skip
