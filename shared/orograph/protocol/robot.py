"""The robot's side of the map protocol (protocol.md): own registers up, at least once; the GLRM down, without a gap."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from orograph.messages import REGISTER, Ack, Batch, Delta, Digest, Fenced, Message, Packed, Welcome
from orograph.protocol.backoff import Backoff
from orograph.protocol.copy import GlrmCopy
from orograph.protocol.fold import whole_prior
from orograph.protocol.joining import Joining
from orograph.protocol.limits import LIMITS, Limits
from orograph.protocol.outbox import Outbox

LINK_UP_NS = 5_000_000_000
SILENCE_NS = 2_500_000_000
"""Longer than the 2 s between digests: whoever speaks after it was away, and is asked at once."""


@dataclass(frozen=True, eq=False)
class SyncResult:
    """What a step brought: when a welcome completed, the robot's whole row."""

    adopted: Packed
    """REGISTER: what the manager holds of this robot; empty except in the step that completes a welcome."""
    first_life: bool
    """The welcome is this process's first, so the row, if any, is of an earlier life."""


class RobotSync:
    """Step object; `prior` is the whole GLRM prior (UPDATE), `nonce` 16 bytes that no other instance has."""

    def __init__(
        self, robot: str, shape: tuple[int, int], prior: Packed, nonce: bytes, seed: int, limits: Limits = LIMITS,
    ) -> None:  # fmt: skip
        size = shape[0] * shape[1]
        self._limits = limits
        self.copy = GlrmCopy(shape, whole_prior(prior, size))
        self._outbox = Outbox(size, limits)
        self._joining = Joining(robot, size, nonce, seed)
        self._batches = Backoff(seed, "robot-mapping", robot, "batch")
        self._requests = Backoff(seed, "robot-mapping", robot, "request")
        self._heard_ns: int | None = None
        self._counts: Counter[str] = Counter()

    @property
    def waiting_cells(self) -> int:
        """Cells that the manager has not acknowledged."""
        return self._outbox.waiting

    @property
    def flushed(self) -> bool:
        """Welcomed by the manager's present life, and nothing is dirty or unacknowledged."""
        return self._joining.may_write and self._outbox.waiting == 0

    @property
    def epoch(self) -> int | None:
        """The epoch this instance writes in; None before it is welcomed and while it is fenced."""
        return self._joining.epoch

    @property
    def fenced(self) -> bool:
        """A later hello for this robot won; nothing is sent."""
        return self._joining.fenced

    @property
    def registers_lost(self) -> int:
        """Registers that the manager had acknowledged and no longer held when it began another life."""
        return self._counts["registers_lost"]

    def link_up(self, now_ns: int) -> bool:
        """Whether the manager was heard within the last 5 s."""
        return self._heard_ns is not None and now_ns - self._heard_ns <= LINK_UP_NS

    @property
    def own(self) -> Packed:
        """Own evidence as it was last offered or adopted (cells,) of UPDATE, confidence 0 for none; only read it."""
        return self._outbox.own

    @property
    def acknowledged(self) -> Packed:
        """The same as the manager is known to hold it, (cells,) of REGISTER."""
        return self._outbox.acked

    def offer(self, records: Packed) -> None:
        """Own evidence that is worth sending (UPDATE, seq ignored); the same value twice is one change."""
        self._outbox.offer(records)

    def step(self, now_ns: int, inbox: Sequence[Message], send: Callable[[Message], None]) -> SyncResult:
        """Take what the manager sent, send what is due."""
        self._outbox.now_ns = now_ns
        adopted = np.zeros(0, REGISTER)
        for message in inbox:
            self._hear(now_ns)
            if isinstance(message, Ack):
                self._take_ack(message, now_ns)
            elif isinstance(message, Welcome):
                row = self._joining.take_welcome(message, now_ns)
                adopted = adopted if row is None else self._begin_epoch(row)
            else:
                self._take_other(message, now_ns)
        self._joining.follow(self.copy.manager_epoch)
        self._send_due(now_ns, send)
        first = bool(len(adopted)) and self._joining.welcomes == 1
        return SyncResult(adopted, first)

    def _hear(self, now_ns: int) -> None:
        if self._heard_ns is None or now_ns - self._heard_ns > SILENCE_NS:
            for pace in (self._batches, self._requests, self._joining):
                pace.hurry(now_ns)
        self._heard_ns = now_ns

    def _take_ack(self, ack: Ack, now_ns: int) -> None:
        if self._joining.hear_ack_of(ack.epoch, now_ns) and not self._joining.asking:
            self._batches.answered()
            cleared = self._outbox.acknowledge(ack.acked["cell"], ack.acked["seq"], ack.epoch)
            self._counts["records_acked"] += cleared

    def _begin_epoch(self, row: Packed) -> Packed:
        self._counts["registers_lost"] += self._outbox.rebase(row, first_life=self._joining.welcomes == 1)
        self._batches.answered()
        return row

    def _take_other(self, message: Message, now_ns: int) -> None:
        if isinstance(message, Delta):
            self.copy.take_delta(message)
            if message.repair:
                self._requests.sent(now_ns)
        elif isinstance(message, Digest):
            self.copy.take_digest(message)
            self._requests.hurry(now_ns)
        elif isinstance(message, Fenced):
            self._joining.take_fenced(message, now_ns)
        else:
            self._counts["unexpected"] += 1

    def _send_due(self, now_ns: int, send: Callable[[Message], None]) -> None:
        hello = self._joining.hello(now_ns)
        if hello is not None:
            send(hello)
        if unanswered := self._outbox.give_up_old(now_ns):
            self._counts["batches_unanswered"] += unanswered
            self._batches.unanswered()
        epoch = self._joining.epoch
        if epoch is not None and self._joining.may_write and self._outbox.waiting and self._batches.due(now_ns):
            self._send_batches(epoch, now_ns, send)
        self._send_request(now_ns, send)

    def _send_batches(self, epoch: int, now_ns: int, send: Callable[[Message], None]) -> None:
        """One batch to try a silent link; as many as may be in flight where answers come, so that a backlog drains."""
        for _ in range(1 if self._batches.backed_off else self._limits.batches_in_flight):
            records = self._outbox.next_batch(now_ns)
            if not len(records):
                return
            send(Batch(epoch, records))
            self._batches.sent(now_ns)
            self._counts["batches_sent"] += 1
            self._counts["records_sent"] += len(records)

    def _send_request(self, now_ns: int, send: Callable[[Message], None]) -> None:
        wanted = self.copy.wanted
        if wanted is None:
            self._requests.answered()
        elif self._requests.due(now_ns):
            send(wanted)
            self.copy.asked()
            self._requests.sent(now_ns)
            self._requests.unanswered()

    def telemetry(self) -> Mapping[str, float]:
        """Counters since the start, and the state of the link."""
        joining = self._joining
        return {
            "epoch": joining.epoch or 0,
            "fenced": float(joining.fenced),
            "fencings": joining.fencings,
            "hellos": joining.hellos,
            "waiting_cells": self._outbox.waiting,
            "oldest_waiting_s": self._outbox.oldest_age_ns * 1e-9,
            "batches_in_flight": self._outbox.flights,
            "batches_sent": self._counts["batches_sent"],
            "batches_unanswered": self._counts["batches_unanswered"],
            "records_sent": self._counts["records_sent"],
            "records_acked": self._counts["records_acked"],
            "registers_lost": self._counts["registers_lost"],
            "foreign_acks": joining.foreign_acks,
            "copy_version": self.copy.version,
            "copy_gaps": self.copy.counts["gaps"],
            "copy_requests": self.copy.counts["requests"],
            "copy_repairs": self.copy.repairs,
            "copy_digest_matches": self.copy.counts["matches"],
            "copy_mismatches": self.copy.counts["mismatches"],
            "copy_rejected": self.copy.counts["rejected"],
            "copy_strangers": self.copy.counts["strangers"],
            "copy_misled": self.copy.counts["misled"],
            "unexpected": self._counts["unexpected"],
        }
