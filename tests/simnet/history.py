"""What a storm leaves behind for the checkers: plain values only."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from orograph.messages import RunEnd


@dataclass
class Acked:
    """The manager said: these would survive kill -9."""

    robot: int
    epoch: int
    cells: np.ndarray
    seqs: np.ndarray


@dataclass
class Commit:
    """What the store holds after a commit (ROBOT_REGISTER), the map that this folds to (CELL), and its version."""

    version: int
    registers: np.ndarray
    glrm: np.ndarray
    revoked: tuple[int, ...]
    """Numbers of the robots that are revoked by then."""


@dataclass
class Sighting:
    """A robot's copy, seen after a step in which it changed."""

    robot: str
    manager_epoch: int
    version: int
    cells: np.ndarray
    commits: int
    """How many commits there had been by then."""


@dataclass
class Load:
    """Greatest sizes seen of one robot's queues."""

    waiting: int = 0
    flights: int = 0
    batch_records: int = 0


@dataclass
class History:
    """One run, from the first message to the end of the mission or the quiet after the heal."""

    seed: int
    prior: np.ndarray
    acked: list[Acked] = field(default_factory=list)
    commits: list[Commit] = field(default_factory=list)
    recovered: list[tuple[bytes, bytes]] = field(default_factory=list)
    """Hash of the map after a recovery, and after recovering the same store once more."""
    sightings: list[Sighting] = field(default_factory=list)
    loads: dict[str, Load] = field(default_factory=dict)
    fenced: set[tuple[str, int]] = field(default_factory=set)
    """Epochs (robot, epoch) that were declared over while an instance wrote in them."""
    restarts: int = 0
    conflicts: int = 0
    returns: int = 0
    """How often one of two with one id, fenced, said hello again after it had heard nothing of the other for 3 s."""
    lost_disks: int = 0
    """Acks, commits and sightings are of the time since then."""
    revoked: tuple[int, ...] = ()
    """Numbers of the robots of which the manager said, at any time, that they are revoked."""
    rejected_changes: int = 0
    """Inputs that had to be rejected but changed the manager's state or were not counted."""
    quiet: bool = False
    heal_to_quiet_ms: int = 0
    """From when the last late message of the storm had come."""
    end: RunEnd | None = None
    """What the orchestrator told the world, if it did; it never can where a robot has a twin."""
    rests_at_end: bool = False
    """Whether all was quiet when it did."""
    manager_hash: bytes = b""
    copy_hashes: dict[str, bytes] = field(default_factory=dict)
    glrm: np.ndarray | None = None
    """The manager's map at the end (CELL)."""
    registers: np.ndarray | None = None
    """The manager's, at the end (ROBOT_REGISTER)."""
    own: dict[int, np.ndarray] = field(default_factory=dict)
    """Robot number -> its mapper's last evidence (UPDATE, one per cell that has any)."""
    alone: dict[int, np.ndarray] = field(default_factory=dict)
    """Robot number -> what its mapper had come to undisturbed, over all the scans of the run (UPDATE)."""
    fault_free_hash: bytes | None = None
    """None where a robot lost its memory, so that the same map is not promised."""
