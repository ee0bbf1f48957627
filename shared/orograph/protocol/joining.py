"""The robot's side of epochs: hello, welcome in parts, and what to do when fenced (protocol.md, "Up").

Fenced means that a later hello won. Two causes look alike from here: a ghost (an old hello of this very robot that
came late) and a second live container with the same id. Only the second is answered by the manager later on, and its
acks, of a higher epoch, arrive here too: the address is the robot's. So: fenced -> listen; then a foreign ack of a
higher epoch -> stay fenced for good and say so; silence -> hello again with a fresh nonce, each time after a longer
pause. Thus a lone robot always comes back, and two never take turns.

A welcomed instance asks once more, with the same nonce, and does not write until it is answered by `Welcome` or
`Fenced`, when it hears a foreign ack of a higher epoch, which may be forged, and when the manager begins another life,
which may hold less than an earlier one acknowledged: its disk was lost, or put back from an older copy.
"""

from __future__ import annotations

import hashlib

import numpy as np

from orograph.messages import Fenced, Hello, Packed, Welcome
from orograph.protocol.backoff import Backoff

LISTEN_NS = 3_000_000_000
LISTEN_MAX_NS = 48_000_000_000
EPOCH_STEP_MAX = 2**20
"""Epochs grow by one per hello and by a random 16 bits per life of the manager; what is further ahead is no epoch."""


class Joining:
    """Which epoch this instance writes in: None until welcomed, and while fenced."""

    def __init__(self, robot: str, size: int, nonce: bytes, seed: int) -> None:
        self._first_nonce, self._nonce, self._size = nonce, nonce, size
        self._pace = Backoff(seed, "robot-mapping", robot, "hello")
        self._parts: dict[int, Packed] = {}
        self._parts_of: tuple[int, int, int] = (0, 0, 0)
        self._pause_ns, self._hello_again_ns = LISTEN_NS, 0
        self._last_epoch = 0
        self.epoch: int | None = None
        self.fenced = False
        self.superseded = False
        self._welcomed_by = self._following = 0
        self._doubting = False
        self.welcomes = self.hellos = self.fencings = self.foreign_acks = 0

    def follow(self, manager_epoch: int) -> None:
        """The life of the manager that this robot's copy follows; 0 while none was heard."""
        self._following = manager_epoch

    @property
    def asking(self) -> bool:
        """Whether it is to be confirmed that this epoch lasts and what the manager holds of this robot."""
        return self.epoch is not None and (self._doubting or self._following not in (0, self._welcomed_by))

    @property
    def may_write(self) -> bool:
        """Whether this instance has an epoch and the manager is known to hold what it acknowledged."""
        return self.epoch is not None and not self.asking

    def hello(self, now_ns: int) -> Hello | None:
        """The hello to send now, if one is due."""
        if self.superseded or self.may_write or not self._pace.due(now_ns):
            return None
        if self.fenced and now_ns < self._hello_again_ns:
            return None
        if self.fenced:
            self._new_nonce()
        self._pace.sent(now_ns)
        self._pace.unanswered()
        self.hellos += 1
        return Hello(nonce=self._nonce)

    def _new_nonce(self) -> None:
        self.fenced = False
        count = self.fencings.to_bytes(8, "little")
        self._nonce = hashlib.blake2b(count, key=self._first_nonce, digest_size=16).digest()
        self._parts.clear()

    def hurry(self, now_ns: int) -> None:
        """The link is back: do not wait for the end of a long pause between hellos."""
        self._pace.hurry(now_ns)

    def take_welcome(self, welcome: Welcome, now_ns: int) -> Packed | None:
        """The robot's whole row, cells ascending, when the last part has come; else None."""
        if self.may_write or self.fenced or welcome.nonce != self._nonce:
            return None
        if self.asking and self._following not in (0, welcome.manager_epoch):
            return None
        if welcome.part >= welcome.parts or (welcome.row["cell"] >= self._size).any():
            return None
        if self._parts_of != (of := (welcome.manager_epoch, welcome.epoch, welcome.parts)):
            self._parts_of = of
            self._parts.clear()
        self._parts[welcome.part] = welcome.row
        self._pace.answered()
        self._pace.sent(now_ns)
        if len(self._parts) < welcome.parts:
            return None
        row = np.concatenate([self._parts[part] for part in sorted(self._parts)])
        self._parts.clear()
        self.epoch = self._last_epoch = welcome.epoch
        self._welcomed_by, self._doubting = welcome.manager_epoch, False
        self.welcomes += 1
        return row[np.unique(row["cell"], return_index=True)[1]]

    def take_fenced(self, fenced: Fenced, now_ns: int) -> bool:
        """Stop writing if it is this instance's epoch that is over; whether it is."""
        if fenced.epoch != self.epoch:
            return False
        self._stop(now_ns)
        return True

    def hear_ack_of(self, epoch: int, now_ns: int) -> bool:
        """Whether an ack is for this instance; to one that is fenced, a later epoch's proves a live other one."""
        self.foreign_acks += epoch != self.epoch
        if self._last_epoch and 0 < epoch - self._last_epoch <= EPOCH_STEP_MAX:
            self._doubting = True
            if self.fenced and not self.superseded:
                self._stop(now_ns)
                self.superseded = True
        return epoch == self.epoch

    def _stop(self, now_ns: int) -> None:
        if not self.fenced:
            self.fencings += 1
        self.epoch, self.fenced, self._doubting = None, True, False
        self._hello_again_ns = now_ns + self._pause_ns
        self._pause_ns = min(2 * self._pause_ns, LISTEN_MAX_NS)
