"""Where the run stands: mapping until the patrol is over, flush until everybody holds one map, then the end."""

from __future__ import annotations

from collections.abc import Collection, Sequence

from orograph.messages import PHASES, ManagerStatus, MappingStatus

MAPPING, FLUSH, END = PHASES
FLUSH_MAX_NS = 60_000_000_000
"""Simulation time that a robot has to bring its last cells home."""
AGREEMENTS = 2
"""Equal statuses in a row from everybody: the first may have crossed a change on its way."""


class RunPhases:
    """mapping -> flush -> end; stepped with statuses in and simulation time as an argument."""

    def __init__(self, robots: Sequence[str], duration_max_ns: int) -> None:
        self.name = MAPPING
        self.began_ns: dict[str, int] = {MAPPING: 0}
        self.all_visited = False
        self.copies_equal = False
        self.gone: Collection[str] = ()
        """Robots that nobody waits for: they never came, or their services ended; the caller says who."""
        self._duration_max_ns = duration_max_ns
        self._manager: tuple[int, bytes] = (0, b"")
        self._agreements = dict.fromkeys(robots, 0)
        self._repeats = 0

    @property
    def complete(self) -> bool:
        """Every waypoint was visited within the time, and every robot's last cells came home."""
        return self.copies_equal and self.all_visited

    def hear_manager(self, status: ManagerStatus) -> None:
        """Take the manager's version and hash; a change starts every count again."""
        known = (status.version, status.glrm_hash)
        if known != self._manager:
            self._manager, self._repeats = known, 0
            self._agreements = dict.fromkeys(self._agreements, 0)
        self._repeats += 1

    def hear_mapping(self, robot: str, status: MappingStatus) -> None:
        """Take a robot's report: one more agreement in a row, or none."""
        held = (status.copy_version, status.copy_hash)
        agrees = status.flushed and held == self._manager
        self._agreements[robot] = self._agreements[robot] + 1 if agrees else 0

    def agreed(self) -> bool:
        """Manager and all robots that are waited for have named one version and hash, twice in a row."""
        awaited = [n for robot, n in self._agreements.items() if robot not in self.gone]
        return min([self._repeats, *awaited]) >= AGREEMENTS

    def step(self, now_ns: int, patrol_finished: bool, all_visited: bool) -> bool:
        """Go on to the next phase where its time has come; True if it did.

        A patrol is finished once nothing is left that anybody could visit; waypoints may have been given up.
        """
        if self.name == MAPPING and (patrol_finished or now_ns >= self._duration_max_ns):
            self.all_visited = all_visited
            return self._enter(FLUSH, now_ns)
        if self.name == FLUSH and (self.agreed() or now_ns - self.began_ns[FLUSH] >= FLUSH_MAX_NS):
            self.copies_equal = self.agreed()
            return self._enter(END, now_ns)
        return False

    def _enter(self, name: str, now_ns: int) -> bool:
        self.name, self.began_ns[name] = name, now_ns
        return True
