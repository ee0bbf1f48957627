"""How the global map came about: every second the cells that changed in it, in bounded memory."""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.lib.recfunctions import require_fields

from orograph.messages import CELL, Packed

CHANGE: Final = np.dtype([("stamp_ns", "<i8"), *[(name, CELL[name]) for name in CELL.names or ()]])
"""A cell as it was from `stamp_ns` on."""


class CellHistory:
    """Changes of cells in order of time; where they take more than `bytes_max`, neighbours in time become one.

    What it holds at its end is the map as it is, however often it has thinned out.
    """

    def __init__(self, bytes_max: int) -> None:
        self._bytes_max = bytes_max
        self._parts: list[Packed] = []

    def append(self, stamp_ns: int, cells: Packed) -> None:
        """Keep cells (n,) CELL, each named once, as they are from a time on; times rise."""
        if not len(cells):
            return
        part: Packed = require_fields(cells, CHANGE)
        part["stamp_ns"] = stamp_ns
        self._parts.append(part)
        while self.nbytes > self._bytes_max and len(self._parts) > 1:
            self._parts = [newest(self._parts[i : i + 2]) for i in range(0, len(self._parts), 2)]

    def rows(self) -> Packed:
        """All that is kept (n,) CHANGE, stamps rising."""
        return np.concatenate(self._parts) if self._parts else np.zeros(0, CHANGE)

    @property
    def nbytes(self) -> int:
        """Memory in use."""
        return sum(part.nbytes for part in self._parts)


def newest(parts: list[Packed]) -> Packed:
    """Parts in order of time as one: each cell's newest state, all from the newest stamp on."""
    rows = np.concatenate(parts)
    _, last = np.unique(rows["cell"][::-1], return_index=True)
    kept: Packed = rows[len(rows) - 1 - last]
    kept["stamp_ns"] = rows["stamp_ns"][-1]
    return kept
