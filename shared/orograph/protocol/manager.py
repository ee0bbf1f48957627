"""The Map Manager's side of the map protocol: validate, store and commit, apply, then acknowledge and publish."""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from typing import Any

import numpy as np
from numpy.lib.recfunctions import require_fields

from orograph.arrays import I64
from orograph.keys import robot_id, robot_number
from orograph.messages import ACKED, REGISTER, Ack, Batch, CellsRequest, Fenced, Hello, Message, Packed
from orograph.node import Note
from orograph.protocol.changes import SurfaceWatch
from orograph.protocol.downlink import Downlink, SendTo
from orograph.protocol.epochs import Epochs
from orograph.protocol.ledger import Ledger
from orograph.protocol.limits import LIMITS, Limits
from orograph.protocol.store import Changes, Granted, Store, StoreFull
from orograph.protocol.tiles import Tiles, map_hash
from orograph.protocol.validate import fault
from orograph.rules import Rules
from orograph.stages import Stage, untimed

REASONS_NOTED_MAX = 1_000
LATER_DRAWS = 2**16
"""By so much at most a store's later manager epochs are apart."""


@dataclass
class _Intake:
    """What one step's messages ask for, before anything is decided durably."""

    batches: defaultdict[str, list[Batch]] = field(default_factory=lambda: defaultdict(list))
    hellos: list[tuple[str, bytes]] = field(default_factory=list)
    fenced: dict[str, int] = field(default_factory=dict)
    granted: list[Granted] = field(default_factory=list)


def _unnoted(kind: str, fields: Mapping[str, Any]) -> None:
    return None


class ManagerSync:
    """Step object; everything it needs after a crash is in `store`.

    `prior` is the whole GLRM prior (UPDATE), `robots` the ids that may write. Raises StoreDamaged when built on a bad
    store, and StoreFailed from `step`: then the process must end and recover. `draw` is a random number of 31 bits:
    manager epochs, and the robots' with them, are counted on from it, so that none is given twice, not even by a
    manager whose store was lost or is an older copy.
    """

    def __init__(
        self, shape: tuple[int, int], prior: Packed, rules: Rules, store: Store, robots: Sequence[str],
        stage: Stage = untimed, limits: Limits = LIMITS, draw: int = 0,
    ) -> None:  # fmt: skip
        held, self._limits = store.load(), limits
        self._size, self._tiles = shape[0] * shape[1], Tiles(shape)
        self._numbers = {robot: robot_number(robot) for robot in robots}
        self._store, self._stage = store, stage
        self._note: Note = _unnoted
        self._reasons_noted: set[tuple[str, str]] = set()
        self._ledger = Ledger(prior, self._size, rules, held)
        self._watch = SurfaceWatch(shape, self._ledger.prior, self._ledger.glrm, held.settled, self._ledger.seen())
        self._epochs = Epochs(held.granted)
        self.manager_epoch = held.manager_epoch + 1 + (draw % LATER_DRAWS if held.manager_epoch else draw)
        self.version = held.version
        self._downlink = Downlink(self.manager_epoch, self.version, self._tiles, self._ledger.glrm, limits)
        self._revoked = frozenset(held.revoked)
        self._to_revoke: tuple[str, ...] = ()
        self._begun = False
        self.store_full = False
        self.rejected: Counter[str] = Counter()
        self.acked: Counter[str] = Counter()
        """Records acknowledged by robot, repetitions included."""
        self._counts: Counter[str] = Counter()

    @property
    def glrm(self) -> Packed:
        """The map (cells,) of CELL; do not write to it."""
        return self._ledger.glrm

    @property
    def first_confident_ns(self) -> I64:
        """Per cell, when its confidence first reached 64; -1 for never."""
        return self._ledger.first_confident_ns

    @property
    def changed_ms(self) -> I64:
        """Per cell, simulation time of the scan that showed its surface's last change; -1 for none."""
        return self._watch.changed_ms

    @property
    def confident_cells(self) -> int:
        """Cells with confidence >= 64 now."""
        return self._ledger.confident_cells

    def hash(self) -> bytes:
        """blake2b-128 of the map."""
        return map_hash(self.glrm)

    def registers(self) -> Packed:
        """All registers (ROBOT_REGISTER) by robot number and cell."""
        return self._ledger.registers()

    def epoch(self, robot: str) -> int:
        """The epoch in which a robot may write; 0 before its first hello."""
        return self._epochs.current(self._numbers[robot])

    @property
    def revoked(self) -> tuple[str, ...]:
        """Robots of which nothing is in the map and nothing is taken, for good."""
        return tuple(robot for robot, number in self._numbers.items() if number in self._revoked)

    def revoke(self, robot: str) -> None:
        """Ask that a robot of this run be revoked in the next step; ask again until `revoked` names it.

        From any thread: what is lost to a race or a full disk is asked again.
        """
        assert robot in self._numbers, robot
        self._to_revoke = (*self._to_revoke, robot)

    def step(self, now_ns: int, inbox: Sequence[tuple[str, Message]], send: SendTo, note: Note = _unnoted) -> None:
        """Take what the robots sent; nothing is acknowledged or published before it is committed."""
        self._note = note
        if not self._begun and not self._begin():
            return
        self._revoke_asked(now_ns)
        intake = self._take_in(now_ns, inbox)
        self._keep_and_answer(intake, now_ns, send)
        self._downlink.step(now_ns, send)

    def _begin(self) -> bool:
        """Make this life's manager epoch durable before anything is said in it."""
        self._begun = self._commit(Changes(self.manager_epoch, self.version))
        return self._begun

    def _revoke_asked(self, now_ns: int) -> None:
        """Fold the map anew without them; what changes goes out as with any commit."""
        asked, self._to_revoke = self._to_revoke, ()
        for robot in sorted(set(asked) - set(self.revoked)):
            number = self._numbers[robot]
            emptied, folded, confident = self._ledger.withdrawal(number, now_ns)
            cells = emptied["cell"].astype(np.int64)
            changes = Changes(
                self.manager_epoch, self.version + 1, confident=confident, revoked=(number,),
                settled=self._watch.forgotten(cells),
            )  # fmt: skip
            if self._commit(changes):
                self._revoked |= {number}
                self._watch.forget(cells)
                changed = self._ledger.apply({number: emptied}, folded, confident, changes.version)
                self._publish(changed, changes.version)
                self._note("revoked", {"robot": robot, "registers": len(emptied), "cells_changed": len(changed)})

    def _publish(self, changed: I64, version: int) -> None:
        self.version = version
        self._downlink.changed(changed, version)

    def _reject(self, robot: str, reason: str) -> None:
        """Count every one; note the first of its kind only, so that a flood does not fill the disk with notes."""
        self.rejected[reason] += 1
        if (robot, reason) not in self._reasons_noted and len(self._reasons_noted) < REASONS_NOTED_MAX:
            self._reasons_noted.add((robot, reason))
            self._note("rejected", {"robot": robot, "reason": reason})

    def _take_in(self, now_ns: int, inbox: Sequence[tuple[str, Message]]) -> _Intake:
        intake, heard = _Intake(), Counter[str]()
        for robot, message in inbox:
            heard[robot] += 1
            if robot not in self._numbers:
                reason: str | None = "unknown-robot"
            elif self._numbers[robot] in self._revoked:
                reason = "revoked"
            elif heard[robot] > self._limits.messages_per_step:
                reason = "flood"
            else:
                reason = fault(message, self._size, self._tiles.count, now_ns)
            if reason is None:
                self._sort(intake, robot, message)
            else:
                self._reject(robot, reason)
        return intake

    def _sort(self, intake: _Intake, robot: str, message: Message) -> None:
        if isinstance(message, Hello):
            self._take_hello(intake, robot, message.nonce)
        elif isinstance(message, CellsRequest):
            if message.manager_epoch in (0, self.manager_epoch):
                self._downlink.repair(robot, message)
            else:
                self._reject(robot, "other-life")
        elif isinstance(message, Batch):
            self._take_batch(intake, robot, message)

    def _take_hello(self, intake: _Intake, robot: str, nonce: bytes) -> None:
        intake.hellos.append((robot, nonce))
        number = self._numbers[robot]
        asked = [grant for grant in intake.granted if grant.robot == number]
        if self._epochs.of(number, nonce) is None and nonce not in [grant.nonce for grant in asked]:
            epoch = max(self._epochs.current(number) + 1, self.manager_epoch) + len(asked)
            intake.granted.append(Granted(number, nonce, epoch))

    def _take_batch(self, intake: _Intake, robot: str, batch: Batch) -> None:
        """A lower epoch than the current is over, by a later hello; a higher one is of another store.

        Nothing is answered to the latter: the robot will ask this life of the manager for its row.
        """
        current = self._epochs.current(self._numbers[robot])
        if batch.epoch == current and not any(grant.robot == self._numbers[robot] for grant in intake.granted):
            intake.batches[robot].append(batch)
        elif batch.epoch > current:
            self._reject(robot, "unknown-epoch")
        elif batch.epoch < current:
            intake.fenced[robot] = batch.epoch
            self.rejected["fenced-epoch"] += 1

    def _news(self, intake: _Intake) -> dict[int, Packed]:
        news = {}
        for robot, batches in intake.batches.items():
            rows = np.concatenate([_in_epoch(batch) for batch in batches])
            number = self._numbers[robot]
            winners = self._ledger.news(number, rows)
            self._counts["repeated_records"] += len(rows) - len(winners)
            if len(winners):
                news[number] = winners
        return news

    def _keep_and_answer(self, intake: _Intake, now_ns: int, send: SendTo) -> None:
        news, settled = self._news(intake), self._watch.due(now_ns)
        if news or intake.granted or len(settled):
            cells = np.unique(np.concatenate([np.zeros(0, np.int64), *(rows["cell"] for rows in news.values())]))
            cells = cells.astype(np.int64)
            with self._stage("fold"):
                folded = self._ledger.folded(cells, news)
            confident = self._ledger.newly_confident(folded, now_ns)
            version = self.version + bool(news)
            changes = Changes(self.manager_epoch, version, news, tuple(intake.granted), confident, settled=settled)
            if not self._commit(changes):
                return
            self._apply(changes, folded, now_ns)
        self._answer(intake, send)

    def _commit(self, changes: Changes) -> bool:
        """False when the disk is full: then nothing was kept, nobody gets an answer, and the robots try again."""
        try:
            self._store.commit(changes)
        except StoreFull as error:
            if not self.store_full:
                self._note("store-full", {"error": str(error)})
            self.store_full = True
            self._counts["commits_refused"] += 1
            return False
        if self.store_full:
            self._note("store-freed", {})
        self.store_full = False
        self._counts["commits"] += 1
        return True

    def _apply(self, changes: Changes, folded: Packed, now_ns: int) -> None:
        changed = self._ledger.apply(changes.registers, folded, changes.confident, changes.version)
        self._publish(changed, changes.version)
        for change in self._watch.settle(changes.settled):
            self._note("changed", asdict(change))
            self._counts["surface_changes"] += 1
        self._watch.look(changes.registers.values(), now_ns)
        for grant in changes.granted:
            self._epochs.add(grant)
            self._note("hello", {"robot": robot_id(grant.robot), "epoch": grant.epoch})

    def _answer(self, intake: _Intake, send: SendTo) -> None:
        for robot, batches in intake.batches.items():
            for batch in batches:
                send(robot, _ack(batch))
                self.acked[robot] += len(batch.records)
        for robot, epoch in intake.fenced.items():
            send(robot, Fenced(epoch))
            self._note("fenced", {"robot": robot, "epoch": epoch})
            self._counts["fenced"] += 1
        for robot, nonce in intake.hellos:
            number = self._numbers[robot]
            granted = self._epochs.of(number, nonce)
            assert granted is not None
            if granted < self._epochs.current(number):
                send(robot, Fenced(granted))
            self._downlink.welcome(robot, nonce, granted, self._ledger.row(number))

    def telemetry(self) -> Mapping[str, float]:
        """Counters since the start, and what is held."""
        return {
            "manager_epoch": self.manager_epoch,
            "version": self.version,
            "confident_cells": self.confident_cells,
            "cells": self._size,
            "store_full": float(self.store_full),
            "surface_changes": self._counts["surface_changes"],
            "robots_revoked": len(self._revoked),
            "commits": self._counts["commits"],
            "commits_refused": self._counts["commits_refused"],
            "records_acked": self.acked.total(),
            "repeated_records": self._counts["repeated_records"],
            "fenced": self._counts["fenced"],
            "rejected": self.rejected.total(),
            **{f"rejected_{reason.replace('-', '_')}": n for reason, n in sorted(self.rejected.items())},
            **{name: self._downlink.counts[name] for name in ("beats", "digests", "answers")},
        }


def _in_epoch(batch: Batch) -> Packed:
    rows: Packed = require_fields(batch.records, REGISTER)
    rows["epoch"] = batch.epoch
    return rows


def _ack(batch: Batch) -> Ack:
    acked = np.zeros(len(batch.records), ACKED)
    acked["cell"], acked["seq"] = batch.records["cell"], batch.records["seq"]
    return Ack(batch.epoch, acked)
