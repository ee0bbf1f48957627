"""Rows of numbers by frame, for the report, in bounded memory."""

from __future__ import annotations

import numpy as np

from orograph.arrays import F64

ROWS_AT_FIRST = 1024


class History:
    """The course of a run: every frame's row, and once the memory is full every second, fourth, ... frame's.

    Frames are counted from simulation time 0, so histories of one run that have thinned out still share their stamps.
    """

    def __init__(self, columns: int, frame_ns: int, bytes_max: int) -> None:
        self._frame_ns, self._stride, self._count = frame_ns, 1, 0
        self._rows_max = max(2, bytes_max // (8 * columns))
        self._rows = np.empty((min(ROWS_AT_FIRST, self._rows_max), columns))

    def append(self, stamp_ns: int, *values: float) -> None:
        """Keep a row (stamp_ns, *values), if its frame's turn is still kept; stamps rise."""
        if stamp_ns // self._frame_ns % self._stride:
            return None
        if self._count == self._rows_max:
            self._thin_out()
            return self.append(stamp_ns, *values)
        if self._count == len(self._rows):
            self._rows = np.resize(self._rows, (min(2 * self._count, self._rows_max), self._rows.shape[1]))
        self._rows[self._count] = stamp_ns, *values
        self._count += 1
        return None

    def _thin_out(self) -> None:
        self._stride *= 2
        rows = self.rows()
        kept = rows[(rows[:, 0] // self._frame_ns) % self._stride == 0]
        self._count = len(kept)
        self._rows[: self._count] = kept

    def rows(self) -> F64:
        """What is kept (n, columns): stamps [ns] first. A view, until the next append."""
        return self._rows[: self._count]

    @property
    def nbytes(self) -> int:
        """Memory in use."""
        return self._rows.nbytes
