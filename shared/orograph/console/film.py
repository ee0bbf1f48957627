"""A run, or what of it has been so far, as the page shows it: courses by time, and how the map came about."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.lib.recfunctions import require_fields

from orograph.arrays import F64, I64
from orograph.messages import CELL, Packed
from orograph.scene.site import Site

Event = Mapping[str, Any]
X, Y, Z, YAW, RADIO = 1, 2, 3, 4, 5
"""Columns of a robot's course, behind its stamp."""
NO_ROWS: F64 = np.zeros((0, 2))


@dataclass(frozen=True, eq=False)
class Film:
    """Courses are rows (n, columns) that begin with their stamp [ns], rising; of a live run they grow."""

    site: Site
    title: str
    robots: Mapping[str, F64]
    """Robot -> x, y, z [m], yaw [rad], whether it has radio."""
    vehicles: Sequence[F64]
    """x, y [m], yaw [rad]."""
    backlog: Mapping[str, F64]
    """Robot -> cells that wait for their acknowledgement."""
    changes: Packed
    """CHANGE, stamps rising."""
    events: Sequence[Event]
    """Ordered by stamp_ns."""
    scans: Mapping[str, Callable[[], F64]]
    """Robot -> points (n, 3) of its last scan in the map frame, where one is known; the same array until the next."""
    registers: Callable[[], Packed]
    """ROBOT_REGISTER, in any order, as they are at the end of what there is."""
    live: bool = False

    @property
    def end_ns(self) -> int:
        """The newest stamp of anything that moves."""
        return max((int(rows[-1, 0]) for rows in self.robots.values() if len(rows)), default=0)

    def pose(self, robot: str, stamp_ns: int) -> F64 | None:
        """A robot's row at a time; None before its first."""
        return row_at(self.robots[robot], stamp_ns)

    def waiting(self, robot: str, stamp_ns: int) -> int:
        """A robot's backlog at a time, 0 where it is not known."""
        row = row_at(self.backlog.get(robot, NO_ROWS), stamp_ns)
        return 0 if row is None else int(row[1])

    def past(self, stamp_ns: int) -> list[Event]:
        """Events up to a time."""
        return [event for event in self.events if int(event.get("stamp_ns", 0)) <= stamp_ns]

    def legs(self, stamp_ns: int) -> dict[str, list[int]]:
        """Robot -> the waypoints of its newest mission at a time."""
        found = {}
        for event in self.past(stamp_ns):
            if event.get("event") == "mission":
                found[str(event["robot"])] = [int(i) for i in event.get("waypoints", ())]
        return found


def row_at(rows: F64, stamp_ns: int) -> F64 | None:
    """The newest row of a time or before, None where there is none."""
    i = int(np.searchsorted(rows[:, 0], stamp_ns, "right")) - 1
    return None if i < 0 else rows[i]


class MapCourse:
    """The map at the time last asked for: goes forward by what changed since, back by beginning anew."""

    def __init__(self, prior: Packed) -> None:
        self._prior: Packed = require_fields(prior, CELL)
        self._restart()

    def _restart(self) -> None:
        self.cells = self._prior.copy()
        self.changed_ns: I64 = np.full(len(self.cells), -1, np.int64)
        """When each cell changed last; -1 where it is still the prior."""
        self._stamp_ns, self.taken = -1, 0

    def seek(self, changes: Packed, stamp_ns: int) -> None:
        """Make `cells` (n,) CELL and `changed_ns` (n,) what they are at a time; `changes` only ever grow."""
        if stamp_ns < self._stamp_ns or len(changes) < self.taken:
            self._restart()
        until = int(np.searchsorted(changes["stamp_ns"], stamp_ns, "right"))
        news = changes[self.taken : until]
        # Of a cell named more than once NumPy keeps the last, which is the newest.
        self.cells[news["cell"]] = require_fields(news, CELL)
        self.changed_ns[news["cell"]] = news["stamp_ns"]
        self._stamp_ns, self.taken = stamp_ns, max(until, self.taken)
