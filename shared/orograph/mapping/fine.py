"""Fine blocks that rolled out of the window, kept whole; memory grows with the area that was seen, up to a bound."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
import numpy.typing as npt

from orograph.arrays import F32, Mask
from orograph.grid import Grid
from orograph.layers import CONFIDENCE, CONFIDENCE_TOP, FREE_SHARE, WIDTH
from orograph.mapping.cells import Ticks, Values, unknown_values

Window = tuple[int, int]
Fine = tuple[Values, Ticks, F32]
"""Values (cells, WIDTH), ticks (cells,) and standing (cells,) of a square window, row by row."""


class FineBlocks:
    """Blocks of `factor` x `factor` fine cells by their (row, col) in GLRM cells, on the GLRM or off it."""

    def __init__(self, blocks: int, factor: int, most: float) -> None:
        """The window has `blocks` x `blocks` of them; of more than `most` those kept longest ago are forgotten."""
        self._blocks, self._factor, self._most = blocks, factor, most
        self._kept: dict[Window, Fine] = {}

    def keep(self, fine: Fine, window: Window, leaving: Mask) -> None:
        """Copy those blocks of the window that are `leaving` (blocks, blocks) and of which anything is known."""
        rows, cols = np.nonzero(leaving)
        values, ticks, standing = (layer[rows, :, cols] for layer in self._by_block(fine))
        told = (values[..., [CONFIDENCE, CONFIDENCE_TOP, FREE_SHARE]] > 0).any(axis=(1, 2, 3))
        for i in np.flatnonzero(told):
            place = window[0] + int(rows[i]), window[1] + int(cols[i])
            self._kept.pop(place, None)
            self._kept[place] = values[i].copy(), ticks[i].copy(), standing[i].copy()
        while len(self._kept) > self._most:
            del self._kept[next(iter(self._kept))]

    def forget(self, places: Iterable[Window]) -> None:
        """Keep the blocks of these (row, col) no longer."""
        for place in places:
            self._kept.pop(place, None)

    def put_back(self, fine: Fine, window: Window, entered: Mask) -> None:
        """Set those blocks that `entered` (blocks, blocks) the window and are kept, in place."""
        arrays = self._by_block(fine)
        for row, col in np.argwhere(entered).tolist():
            block = self._kept.get((window[0] + row, window[1] + col))
            for array, kept in zip(arrays, block or (), strict=False):
                array[row, :, col] = kept

    def bounds(self) -> tuple[int, int, int, int] | None:
        """First row and col, and one past the last of each, of what is kept; None where that is nothing."""
        if not self._kept:
            return None
        places = np.array(list(self._kept))
        return (*places.min(axis=0).tolist(), *(places.max(axis=0) + 1).tolist())

    def assembled(self, glrm: Grid) -> tuple[Grid, Values]:
        """The smallest grid of fine cells over everything kept, one block where that is nothing, and its values."""
        row, col, end_row, end_col = self.bounds() or (0, 0, 1, 1)
        rows, cols = end_row - row, end_col - col
        grid = glrm.window(row, col, (rows, cols)).refined(self._factor)
        values = unknown_values(grid.size)
        by_block = values.reshape(rows, self._factor, cols, self._factor, WIDTH)
        for (r, c), (block, _, _) in self._kept.items():
            by_block[r - row, :, c - col] = block
        return grid, values

    def _by_block(self, fine: Fine) -> tuple[npt.NDArray[np.float32], Ticks, F32]:
        """Views (blocks, factor, blocks, factor, ...)."""
        sides = (self._blocks, self._factor, self._blocks, self._factor)
        values, ticks, standing = fine
        return values.reshape(*sides, WIDTH), ticks.reshape(sides), standing.reshape(sides)
