"""The Map Manager's registers and the map folded from them, changed by what was committed (mapping.md section 5)."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from orograph.arrays import I64
from orograph.layers import CONFIDENT
from orograph.messages import REGISTER, ROBOT_REGISTER, Packed
from orograph.protocol.fold import fold, same_values, whole_prior
from orograph.protocol.store import CONFIDENT as CONFIDENT_RECORD
from orograph.protocol.store import StoredState
from orograph.registers import has_evidence, of_robot
from orograph.rules import Rules


def newest_per_cell(rows: Packed) -> Packed:
    """Of ROW_RECORDs (n,), the greatest (epoch, seq) of each cell, cells ascending."""
    ordered = rows[np.lexsort((rows["seq"], rows["epoch"], rows["cell"]))]
    last = np.append(ordered["cell"][1:] != ordered["cell"][:-1], True)
    return ordered[last] if len(ordered) else ordered


class Ledger:
    """Registers by robot number, the `prior`, the GLRM (`glrm`, CELL with versions), when cells became confident."""

    def __init__(self, prior: Packed, size: int, rules: Rules, held: StoredState) -> None:
        self.prior, self._rules, self._size = whole_prior(prior, size), rules, size
        self._rows: dict[int, Packed] = {}
        for robot in sorted(held.registers):
            self._put(robot, held.registers[robot])
        self.first_confident_ns = np.full(size, -1, np.int64)
        self.first_confident_ns[held.confident["cell"]] = held.confident["stamp_ns"]
        self.glrm = self._recovered(held.version)

    def _recovered(self, version: int) -> Packed:
        glrm = self.folded(np.arange(self._size), {})
        glrm["version"][self.seen()] = version
        return glrm

    def seen(self) -> I64:
        """Cells of which any register tells, ascending."""
        evidence = np.zeros(self._size, np.bool_)
        for row in self._rows.values():
            evidence |= has_evidence(row)
        return np.flatnonzero(evidence)

    def _put(self, robot: int, rows: Packed) -> None:
        if robot not in self._rows:
            self._rows[robot] = np.zeros(self._size, REGISTER)
            self._rows = {number: self._rows[number] for number in sorted(self._rows)}
        self._rows[robot][rows["cell"]] = rows

    def row(self, robot: int) -> Packed:
        """A robot's registers (REGISTER), cells ascending; empty if it has none."""
        row: Packed = self._rows.get(robot, np.zeros(0, REGISTER))
        with_evidence: Packed = row[has_evidence(row)]
        return with_evidence

    def news(self, robot: int, rows: Packed) -> Packed:
        """Of these ROW_RECORDs, those that win over what is held: a greater (epoch, seq) of a cell."""
        rows = newest_per_cell(rows)
        if robot not in self._rows:
            return rows
        held = self._rows[robot][rows["cell"]]
        same_epoch = rows["epoch"] == held["epoch"]
        winners: Packed = rows[(rows["epoch"] > held["epoch"]) | (same_epoch & (rows["seq"] > held["seq"]))]
        return winners

    def folded(self, cells: I64, news: Mapping[int, Packed]) -> Packed:
        """These cells (n,), ascending, as they will be once `news` (robot number -> ROW_RECORDs) is held."""
        robots = sorted({*self._rows, *news})
        columns = np.zeros((len(robots), len(cells)), REGISTER)
        for line, robot in enumerate(robots):
            if robot in self._rows:
                columns[line] = self._rows[robot][cells]
            if robot in news:
                columns[line, np.searchsorted(cells, news[robot]["cell"])] = news[robot]
        return fold(self.prior[cells], columns, self._rules)

    def newly_confident(self, folded: Packed, now_ns: int) -> Packed:
        """Which of these cells reach confidence 64 for the first time, with the time."""
        cells = folded["cell"][folded["confidence"] >= CONFIDENT]
        return _stamped(cells[self.first_confident_ns[cells] < 0], now_ns)

    def withdrawal(self, robot: int, now_ns: int) -> tuple[Packed, Packed, Packed]:
        """What it takes to be without a robot: its registers emptied (news), its cells folded, and confident anew.

        A cell that is no longer confident without it never was.
        """
        emptied = np.zeros(len(self.row(robot)), REGISTER)
        emptied["cell"] = self.row(robot)["cell"]
        folded = self.folded(emptied["cell"].astype(np.int64), {robot: emptied})
        doubted = folded["cell"][folded["confidence"] < CONFIDENT]
        undone = _stamped(doubted[self.first_confident_ns[doubted] >= 0], -1)
        return emptied, folded, np.concatenate([self.newly_confident(folded, now_ns), undone])

    def apply(self, news: Mapping[int, Packed], folded: Packed, confident: Packed, version: int) -> I64:
        """Hold what has been committed; the cells whose value changed, now of `version`."""
        for robot, rows in news.items():
            self._put(robot, rows)
        self.first_confident_ns[confident["cell"]] = confident["stamp_ns"]
        changed = folded[~same_values(folded, self.glrm[folded["cell"]])]
        changed["version"] = version
        cells: I64 = changed["cell"].astype(np.int64)
        self.glrm[cells] = changed
        return cells

    def registers(self) -> Packed:
        """All registers as ROBOT_REGISTER records, by robot number, then cell."""
        rows = [of_robot(robot, self.row(robot)) for robot in self._rows]
        return np.concatenate([np.zeros(0, ROBOT_REGISTER), *rows])

    @property
    def confident_cells(self) -> int:
        """Cells with confidence >= 64 now."""
        return int(np.count_nonzero(self.glrm["confidence"] >= CONFIDENT))


def _stamped(cells: Packed, stamp_ns: int) -> Packed:
    stamped = np.zeros(len(cells), CONFIDENT_RECORD)
    stamped["cell"], stamped["stamp_ns"] = cells, stamp_ns
    return stamped
