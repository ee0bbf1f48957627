"""When a cell's surface really changes: something stands where nothing did, or is gone (mapping.md 7.7).

An observation kept beside the map, by the Map Manager alone: what one robot saw standing and another sees gone is in no
robot's register. The map itself stays a function of the registers.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from orograph.arrays import I64, U1, Mask
from orograph.layers import SHARE_ONE, UNKNOWN_HEIGHT
from orograph.messages import Packed
from orograph.node import Every
from orograph.protocol.store import SETTLED
from orograph.rules import TOP_SURE

UNSURE, OPEN, STANDS = 0, 1, 2
"""What a cell says of what stands on it."""
SEEN_FREE = 0.1
"""Of so much of a cell seen free, and nothing standing on it: nothing stands there."""
SOME_WALLS = 0.03
"""Fewer are a sliver of what stands on the next cell; a car shows as many."""
HOLD_NS = 5_000_000_000
"""What says the same for so long has settled; a vehicle that drives by is gone sooner."""
CHECK_NS = 500_000_000
TALL_MM, AS_HIGH_MM = 2_500, 1_000
"""What is taller is a wall, of which one sees now more and now less; a wall beside one as high is that one's edge."""
EDGE_HOLD_NS = 30_000_000_000
"""What goes beside what still stands waits so long for that to go too."""
NEVER = -1


def surface_of(cells: Packed) -> U1:
    """UNSURE, OPEN or STANDS (n,) of cells (n,) with CELL's layers that robots have seen.

    A sure top over some walls stands; a tenth seen free, without a wall or a top, is open.
    """
    stands = (cells["confidence_top"] >= TOP_SURE) & (cells["wall_share"] >= round(SOME_WALLS * SHARE_ONE))
    seen_free = cells["free_share"] >= round(SEEN_FREE * SHARE_ONE)
    is_open = (cells["confidence_top"] == 0) & (cells["wall_share"] == 0) & seen_free
    return np.where(stands, STANDS, np.where(is_open, OPEN, UNSURE)).astype(np.uint8)


@dataclass(frozen=True)
class SurfaceChange:
    """A cell changed from one settled surface to another; a top is None where nothing stands."""

    cell: int
    since_ms: int
    """Simulation time of the scan that first showed it."""
    from_top_m: float | None
    to_top_m: float | None


class SurfaceWatch:
    """Per cell what has settled, and since when it says otherwise; `glrm` (CELL) is the manager's own map."""

    def __init__(self, shape: tuple[int, int], prior: Packed, glrm: Packed, settled: Packed, seen: I64) -> None:
        """`settled` are SETTLED records of the store, `seen` the cells of which robots have told anything."""
        (self._rows, self._cols), size = shape, len(glrm)
        self._glrm, self._built = glrm, prior["wall_share"] > 0
        self.settled = np.zeros(size, SETTLED)
        self.settled["cell"], self.settled["changed_ms"] = np.arange(size), NEVER
        self.settled[settled["cell"]] = settled
        self._says = np.zeros(size, np.uint8)
        self._says_since_ns, self._since_ms = np.zeros(size, np.int64), np.zeros(size, np.int64)
        self._check = Every(CHECK_NS)
        self._seen_before = seen

    @property
    def changed_ms(self) -> I64:
        """Per cell, simulation time of the scan that showed its last change; NEVER where there was none."""
        return self.settled["changed_ms"].astype(np.int64)

    def look(self, news: Iterable[Packed], now_ns: int) -> None:
        """The cells of these registers (REGISTER, each (n,)) have been folded anew."""
        for rows in news:
            self._hear(rows["cell"].astype(np.int64), rows["tick"].astype(np.int64), now_ns)

    def _hear(self, cells: I64, ticks_ms: I64, now_ns: int) -> None:
        surface = surface_of(self._glrm[cells])
        other = surface != self._says[cells]
        self._says[cells[other]] = surface[other]
        self._says_since_ns[cells[other]] = now_ns
        self._since_ms[cells[other]] = ticks_ms[other]

    def due(self, now_ns: int) -> Packed:
        """SETTLED records (k,) of cells that have said something new for long enough; asked again until `settle`."""
        if len(self._seen_before):
            self._hear(self._seen_before, np.full(len(self._seen_before), now_ns // 1_000_000), now_ns)
            self._seen_before = self._seen_before[:0]
        if not self._check.due(now_ns):
            return self.settled[:0]
        new = (self._says != UNSURE) & (self._says != self.settled["surface"])
        held_ns = now_ns - self._says_since_ns
        cells = np.flatnonzero(new & (held_ns >= HOLD_NS))
        known = self.settled["surface"][cells] != UNSURE
        edge = np.array([seen and self._is_an_edge(cell) for cell, seen in zip(cells, known, strict=True)], np.bool_)
        waits = edge & (self._says[cells] == OPEN) & (held_ns[cells] < EDGE_HOLD_NS)
        self._since_ms[cells[waits]] = now_ns // 1_000_000
        return self._records(cells[~waits], (known & ~edge)[~waits])

    def _records(self, cells: I64, changed: Mask) -> Packed:
        records = self.settled[cells]
        records["since_ms"] = self._since_ms[cells]
        records["changed_ms"][changed] = records["since_ms"][changed]
        records["surface"] = self._says[cells]
        records["top"] = np.where(records["surface"] == STANDS, self._glrm["height_top"][cells], UNKNOWN_HEIGHT)
        return records

    def _is_an_edge(self, cell: np.int64) -> bool:
        """Whether what appeared on a cell, or went, is that of a cell beside it.

        There it stood before and stands, or by the prior it does and nobody has seen otherwise.
        """
        gone = self._says[cell] == OPEN
        top = int((self.settled["top"] if gone else self._glrm["height_top"])[cell])
        ground = int(self._glrm["height"][cell])
        beside = self._beside(cell)
        before = self.settled["since_ms"][beside] < self._since_ms[cell] - EDGE_HOLD_NS // 1_000_000
        stood = (self.settled["surface"][beside] == STANDS) & (before | gone) & (self._says[beside] == STANDS)
        told = self._built[beside] & (self.settled["surface"][beside] != OPEN) & (self._says[beside] != OPEN)
        tops = self._glrm["height_top"][beside][stood | told].astype(np.int64)
        if ground != UNKNOWN_HEIGHT and top - ground < TALL_MM:
            return bool((np.abs(tops - top) <= AS_HIGH_MM // 2).any())
        return bool((tops >= top - AS_HIGH_MM).any())

    def _beside(self, cell: np.int64) -> I64:
        row, col = divmod(int(cell), self._cols)
        rows, cols = (range(max(0, i - 1), min(n, i + 2)) for i, n in ((row, self._rows), (col, self._cols)))
        return np.array([r * self._cols + c for r in rows for c in cols if (r, c) != (row, col)], np.int64)

    def settle(self, records: Packed) -> list[SurfaceChange]:
        """These SETTLED records have been committed; those among them that are changes."""
        before = self.settled[records["cell"]]
        self.settled[records["cell"]] = records
        return [
            SurfaceChange(int(new["cell"]), int(new["changed_ms"]), _top_m(old), _top_m(new))
            for old, new in zip(before, records, strict=True)
            if old["changed_ms"] != new["changed_ms"]
        ]

    def forget(self, cells: I64) -> None:
        """A revoked robot had told of these cells (n,): nothing is known of them until somebody tells of them again."""
        self._says[cells] = UNSURE
        self.settled[cells] = self.forgotten(cells)

    def forgotten(self, cells: I64) -> Packed:
        """The SETTLED records by which nothing is known of cells (n,)."""
        records = self.settled[cells]
        records["surface"], records["top"] = UNSURE, UNKNOWN_HEIGHT
        records["since_ms"] = records["changed_ms"] = NEVER
        return records


def _top_m(record: np.void) -> float | None:
    return int(record["top"]) / 1000 if record["surface"] == STANDS else None
