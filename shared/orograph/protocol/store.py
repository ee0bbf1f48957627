"""What the Map Manager must not forget: the `Store` interface, and one in memory for the simulator.

A commit is atomic and, once it returns, survives kill -9 (protocol.md, "Storage").
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np

from orograph.messages import REGISTER, Packed


class StoreError(Exception):
    """Something is wrong with the store; the message says what a person can do."""


class StoreFull(StoreError):  # noqa: N818 - a state of the disk
    """No room: nothing of this commit was kept; it may be tried again."""


class StoreFailed(StoreError):  # noqa: N818
    """A write or sync failed: what was kept is unknown, so the process must end and recover; never retry."""


class StoreDamaged(StoreError):  # noqa: N818
    """The store is not ours or not whole; it is refused and left as it is."""

    def __init__(self, path: object, why: str) -> None:
        super().__init__(f"{path}: {why}. The file is kept as it is; move it away to start with an empty map.")
        self.why = why


class StoreBusy(StoreError):  # noqa: N818
    """Another process holds the store; nothing is wrong with it."""


CONFIDENT = np.dtype([("cell", "<u4"), ("stamp_ns", "<i8")])
"""When a cell's confidence first reached 64; -1 where that is undone."""

SETTLED = np.dtype([("cell", "<u4"), ("surface", "u1"), ("since_ms", "<i8"), ("changed_ms", "<i8"), ("top", "<i4")])
"""What a cell's surface settled on and since when, and its last change, as `protocol.changes` has it; top in mm."""


@dataclass(frozen=True)
class Granted:
    """An epoch given to a robot for the nonce of its hello."""

    robot: int
    nonce: bytes
    epoch: int


@dataclass(frozen=True, eq=False)
class Changes:
    """One commit: all of it or nothing."""

    manager_epoch: int
    version: int
    registers: Mapping[int, Packed] = field(default_factory=dict)
    """Robot number -> ROW_RECORDs (m,) that replace the robot's registers of those cells."""
    granted: tuple[Granted, ...] = ()
    confident: Packed = field(default_factory=lambda: np.zeros(0, CONFIDENT))
    revoked: tuple[int, ...] = ()
    """Numbers of robots whose registers go, all of them, and of whom none are kept from here on."""
    settled: Packed = field(default_factory=lambda: np.zeros(0, SETTLED))
    """These replace those of the same cells."""


@dataclass(frozen=True, eq=False)
class StoredState:
    """Everything that was ever committed."""

    manager_epoch: int = 0
    version: int = 0
    registers: Mapping[int, Packed] = field(default_factory=dict)
    granted: tuple[Granted, ...] = ()
    """In order of granting."""
    confident: Packed = field(default_factory=lambda: np.zeros(0, CONFIDENT))
    revoked: tuple[int, ...] = ()
    settled: Packed = field(default_factory=lambda: np.zeros(0, SETTLED))


class Store(Protocol):
    """Durable memory of one Map Manager."""

    def load(self) -> StoredState:
        """All that was committed, by this process too; raises StoreDamaged."""

    def commit(self, changes: Changes) -> None:
        """Keep these durably before returning; raises StoreFull (nothing kept) or StoreFailed (end the process)."""


class MemoryStore:
    """A store that outlives its manager in a simulation, with faults on demand.

    `full` refuses commits; `fail_next` makes the next commit fail its sync: "lost" keeps nothing of it, "kept" all.
    """

    def __init__(self) -> None:
        self.full = False
        self.fail_next: str | None = None
        self.commits = 0
        self._held = StoredState()

    def load(self) -> StoredState:
        """All that was committed."""
        return self._held

    def commit(self, changes: Changes) -> None:
        """Keep the changes, unless a fault is set."""
        if self.full:
            raise StoreFull("the simulated disk is full")
        outcome, self.fail_next = self.fail_next, None
        if outcome != "lost":
            self._held = merged(self._held, changes)
            self.commits += 1
        if outcome is not None:
            raise StoreFailed(f"the simulated sync failed ({outcome})")


def merged(held: StoredState, changes: Changes) -> StoredState:
    """What is held after a commit."""
    registers = {**held.registers}
    for robot, rows in changes.registers.items():
        old = registers.get(robot, np.zeros(0, REGISTER))
        kept = old[~np.isin(old["cell"], rows["cell"])]
        registers[robot] = np.concatenate([kept, rows])
    for robot in changes.revoked:
        registers.pop(robot, None)
    return StoredState(
        manager_epoch=changes.manager_epoch,
        version=changes.version,
        registers=registers,
        granted=(*held.granted, *changes.granted),
        confident=np.concatenate([held.confident, changes.confident]),
        revoked=(*held.revoked, *changes.revoked),
        settled=np.concatenate(
            [held.settled[~np.isin(held.settled["cell"], changes.settled["cell"])], changes.settled]
        ),
    )
