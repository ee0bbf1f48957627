"""A robot's registers and which of them the Map Manager may not have: at most one record per cell, for any outage."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from orograph.arrays import I64
from orograph.messages import REGISTER, UPDATE, Packed
from orograph.protocol.fold import same_values
from orograph.protocol.limits import Limits
from orograph.registers import has_evidence

ANSWER_WITHIN_NS = 1_000_000_000
"""A batch without its ack for so long counts as lost."""


@dataclass
class _Flight:
    cells: I64
    seqs: I64
    sent_ns: int


class Outbox:
    """Own registers (cells,) of UPDATE, those last acknowledged (REGISTER), and the batches on their way."""

    def __init__(self, size: int, limits: Limits) -> None:
        self._limits = limits
        self.own = np.zeros(size, UPDATE)
        self.acked = np.zeros(size, REGISTER)
        self.own["cell"] = self.acked["cell"] = np.arange(size)
        self._dirty = np.zeros(size, np.bool_)
        self._dirty_since = np.zeros(size, np.int64)
        self._dirty_since_ns = np.zeros(size, np.int64)
        self._in_flight = np.zeros(size, np.bool_)
        self._flights: list[_Flight] = []
        self._seq = 0
        self._offers = 0
        self.now_ns = 0
        """Stamp of the newest step; a cell's age counts from it."""
        self.waiting = 0

    @property
    def flights(self) -> int:
        """Batches sent, neither acknowledged nor given up."""
        return len(self._flights)

    @property
    def oldest_age_ns(self) -> int:
        """How long the cell that has waited longest is unacknowledged; 0 where nothing waits."""
        return self.now_ns - int(self._dirty_since_ns[self._dirty].min()) if self.waiting else 0

    def offer(self, records: Packed) -> None:
        """Take new values of registers (UPDATE, seq ignored); what says nothing new keeps its seq."""
        now = records[~same_values(records, self.own[records["cell"]], "tick")]
        if not len(now):
            return
        cells = now["cell"].astype(np.int64)
        self.own[cells] = now
        self._renumber(cells)

    def _renumber(self, cells: I64) -> None:
        """Give these registers new seqs and make them dirty; a cell already dirty keeps its age."""
        self.own["seq"][cells] = self._seq + 1 + np.arange(len(cells))
        self._seq += len(cells)
        self._offers += 1
        self._dirty_since[cells] = np.where(self._dirty[cells], self._dirty_since[cells], self._offers)
        self._dirty_since_ns[cells] = np.where(self._dirty[cells], self._dirty_since_ns[cells], self.now_ns)
        self._dirty[cells] = True
        self._count()

    def _count(self) -> None:
        self.waiting = int(np.count_nonzero(self._dirty))

    def next_batch(self, now_ns: int) -> Packed:
        """A batch of dirty records that are not on their way: oldest first, with a share for the largest change."""
        if self.flights >= self._limits.batches_in_flight or not self.waiting:
            return np.zeros(0, UPDATE)
        waiting = np.flatnonzero(self._dirty & ~self._in_flight)
        if len(waiting) > self._limits.batch_cells:
            waiting = self._choose(waiting)
        batch: Packed = self.own[waiting]
        if len(batch):
            self._in_flight[waiting] = True
            self._flights.append(_Flight(waiting, batch["seq"].astype(np.int64), now_ns))
        return batch

    def _choose(self, waiting: I64) -> I64:
        oldest = waiting[np.argsort(self._dirty_since[waiting], kind="stable")]
        share = self._limits.largest_change_share
        first, rest = np.split(oldest, [self._limits.batch_cells - share])
        largest = rest[np.argsort(-self._change(rest), kind="stable")][:share]
        return np.sort(np.concatenate([first, largest]))

    def _change(self, cells: I64) -> I64:
        """How much the registers moved since acknowledged, in 1/100 of the thresholds of mapping.md section 4."""
        own, acked = self.own[cells], self.acked[cells]
        moved = {
            name: np.abs(own[name].astype(np.int64) - acked[name]) for name in ("height", "occupation", "confidence")
        }
        scaled = moved["height"] + 4 * moved["occupation"] + 6 * moved["confidence"]
        return np.where(~has_evidence(acked), np.iinfo(np.int64).max // 2, scaled)

    def acknowledge(self, cells: npt.NDArray[Any], seqs: npt.NDArray[Any], epoch: int) -> int:
        """Clear the cells whose seq still matches, and say how many; the rest stays dirty."""
        inside = cells < len(self.own)
        cells, seqs = cells[inside].astype(np.int64), seqs[inside].astype(np.int64)
        cells_now = np.unique(cells[(self.own["seq"][cells] == seqs) & self._dirty[cells]])
        self._clear(cells_now, epoch)
        self._land(cells << 32 | seqs)
        return len(cells_now)

    def _clear(self, cells: I64, epoch: int) -> None:
        """These own registers are held as of this epoch."""
        self._dirty[cells] = False
        for name in UPDATE.names or ():
            self.acked[name][cells] = self.own[name][cells]
        self.acked["epoch"][cells] = epoch
        self._count()

    def _land(self, keys: I64) -> None:
        for flight in self._flights:
            landed = np.isin(flight.cells << 32 | flight.seqs, keys)
            self._in_flight[flight.cells[landed]] = False
            flight.cells, flight.seqs = flight.cells[~landed], flight.seqs[~landed]
        self._flights = [flight for flight in self._flights if len(flight.cells)]

    def give_up_old(self, now_ns: int) -> int:
        """Count unanswered batches as lost, so that their cells go again; how many there were."""
        old = [flight for flight in self._flights if now_ns - flight.sent_ns >= ANSWER_WITHIN_NS]
        for flight in old:
            self._in_flight[flight.cells] = False
        self._flights = [flight for flight in self._flights if now_ns - flight.sent_ns < ANSWER_WITHIN_NS]
        return len(old)

    def rebase(self, row: Packed, first_life: bool) -> int:
        """Go on from the row (REGISTER, cells ascending) that the manager holds of this robot.

        What the manager holds and the robot does not is adopted; what the robot holds otherwise is dirty. In a
        process's first life both may hold a cell: the row stands until the mapper, which fuses the two, offers the
        result, so that a restart never replaces much evidence by little (protocol.md, invariant 10). Returns how many
        registers had been acknowledged that the row lacks or has older.
        """
        held = np.zeros(len(self.own), REGISTER)
        held[row["cell"]] = row
        mine, theirs = has_evidence(self.own), has_evidence(held)
        takes = theirs if first_life else theirs & ~mine
        lost = _older(held, self.acked)
        for name in set(UPDATE.names or ()) - {"cell"}:
            self.own[name][takes] = held[name][takes]
        self.acked = held
        self._flights, self._in_flight[:], self._dirty[:] = [], False, False
        differs = mine & ~(theirs & same_values(self.own, held, "tick"))
        self._renumber(np.flatnonzero(differs & ~takes))
        return int(np.count_nonzero(lost))


def _older(rows: Packed, others: Packed) -> npt.NDArray[np.bool_]:
    """Where registers (n,) of REGISTER lose against others: a smaller (epoch, seq); none has (0, 0)."""
    same_epoch = rows["epoch"] == others["epoch"]
    older: npt.NDArray[np.bool_] = (rows["epoch"] < others["epoch"]) | (same_epoch & (rows["seq"] < others["seq"]))
    return older
