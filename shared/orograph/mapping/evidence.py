"""What one robot's own laser saw: fine in a window that rolls with it, coarse over the GLRM (mapping.md section 4).

The coarse values follow the fine ones block by block, so what rolls out is already kept, and what rolls in starts from
them. A block that rolls in and out without new points keeps its value: means of equal values are that value.
"""

from __future__ import annotations

import math

import numpy as np

from orograph.arrays import F32, I32, I64, U1, Mask
from orograph.grid import Grid
from orograph.layers import CONFIDENCE, CONFIDENCE_TOP, FREE_SHARE, WIDTH
from orograph.mapping.cells import Cells, Ticks, Values, unknown_values
from orograph.mapping.fine import FineBlocks
from orograph.mapping.fusion_kernels import fuse_cells
from orograph.mapping.rescaling_kernels import expand_blocks, mark_blocks, rescale_marked
from orograph.mapping.rolling import roll_into
from orograph.mapping.standing_kernels import clear_passed, fuse_scan, fuse_surfaces, standing_cells
from orograph.rules import RealRules


class Evidence:
    """Fine values (HRM, rolling) and coarse values (one GLRM) with the tick [ms] of each cell's newest scan."""

    def __init__(self, glrm: Grid, hrm_cells: int, per_glrm_cell: int, fine_kept: float = 0) -> None:
        """The window is placed by the first `roll_to`; `hrm_cells` is a multiple of `per_glrm_cell`.

        The `fine_kept` blocks that rolled out last come back whole.
        """
        assert hrm_cells % per_glrm_cell == 0, (hrm_cells, per_glrm_cell)
        self.glrm, self.factor = glrm, per_glrm_cell
        self.blocks = hrm_cells // per_glrm_cell
        """Blocks on a side of the window."""
        self.kept = FineBlocks(self.blocks, per_glrm_cell, fine_kept) if fine_kept else None
        self.coarse, self.coarse_ticks = unknown_values(glrm.size), np.zeros(glrm.size, np.uint32)
        self.values, self.ticks = unknown_values(hrm_cells**2), np.zeros(hrm_cells**2, np.uint32)
        self.window: tuple[int, int] | None = None
        """GLRM (row, col) of the window's first block; it may hang over the GLRM's edge."""
        self.standing: F32 = np.zeros(hrm_cells**2, np.float32)
        """Hits less misses of what stands in each fine cell (`standing_kernels`)."""
        self._spare = np.empty_like(self.values), np.empty_like(self.ticks), np.empty_like(self.standing)
        self.stale: Mask = np.ones((self.blocks, self.blocks), np.bool_)
        """Blocks of the window that changed since their user last cleared this."""
        self._marked: Mask = np.zeros(self.blocks**2, np.bool_)
        row, col = np.indices((hrm_cells, hrm_cells), np.int32) // per_glrm_cell
        self._block_of_cell: I32 = (row * self.blocks + col).reshape(-1)

    @property
    def llrm_grid(self) -> Grid:
        """The window in GLRM cells."""
        assert self.window is not None, "no scan yet"
        return self.glrm.window(*self.window, (self.blocks, self.blocks))

    @property
    def grid(self) -> Grid:
        """The window in HRM cells."""
        return self.llrm_grid.refined(self.factor)

    def roll_to(self, x_m: float, y_m: float) -> None:
        """Move the window by as few GLRM cells as bring the position within one GLRM cell of its centre."""
        x0, y0 = self.glrm.origin_m
        corner = (y_m - y0) / self.glrm.cell_m - self.blocks / 2, (x_m - x0) / self.glrm.cell_m - self.blocks / 2
        if self.window is None:
            self._move((math.floor(corner[0] + 0.5), math.floor(corner[1] + 0.5)), None)
            return
        row, col = (held + int(wanted - held) for held, wanted in zip(self.window, corner, strict=True))
        if (row, col) != self.window:
            self._move((row, col), self.window)

    def fuse_scan(self, cells: Cells, values: Values, kinds: U1, tick: int, rules: RealRules) -> None:
        """Fuse one scan's values (k, WIDTH) and kinds (k,) at `tick` [ms] into the fine cells (k,)."""
        if rules.two_surfaces:
            fuse_scan(self.values, self.ticks, self.standing, cells, values, kinds, np.uint32(tick), rules)
        else:
            self._fuse_fine(cells, values, np.full(len(cells), tick, np.uint32), rules)

    def standing_but(self, hit: Cells) -> Cells:
        """Fine cells in which something stands, ascending, without those `hit` (k,)."""
        cells: Cells = standing_cells(self.standing, hit)
        return cells

    def clear_passed(self, cells: Cells, passes: I64, rules: RealRules) -> Cells:
        """Count the rays that passed (k,) against what stands in fine cells (k,); returns those that are free now."""
        freed: Cells = clear_passed(self.values, self.standing, cells, passes, rules.slope_max)
        return freed

    def _fuse_fine(self, cells: Cells, values: Values, ticks: Ticks, rules: RealRules) -> None:
        (fuse_surfaces if rules.two_surfaces else fuse_cells)(self.values, self.ticks, cells, values, ticks, rules)

    def rescale(self, cells: Cells) -> Cells:
        """Bring the coarse values under these fine cells up to date; returns their GLRM cells, ascending."""
        mark_blocks(cells, self._block_of_cell, self._marked, self.stale.reshape(-1))
        touched: Cells = rescale_marked(
            self.values, self.ticks, self.blocks, self.factor, self.window, self.glrm.shape, self._marked, self.coarse,
            self.coarse_ticks,
        )  # fmt: skip
        return touched

    def put(self, glrm_cells: Cells, values: Values, ticks: Ticks) -> None:
        """Set GLRM cells (k,), and the fine cells of those under the window, to values (k, WIDTH) and ticks (k,)."""
        self.coarse[glrm_cells], self.coarse_ticks[glrm_cells] = values, ticks
        within, blocks = self._blocks(glrm_cells)
        self._expand(blocks[within], values[within], ticks[within])

    def fuse_coarse(self, glrm_cells: Cells, values: Values, ticks: Ticks, fine: RealRules, coarse: RealRules) -> None:
        """Fuse values (k, WIDTH) of GLRM cells: into fine cells under the window by `fine`, elsewhere by `coarse`."""
        within, blocks = self._blocks(glrm_cells)
        away = ~within
        fuse_far = fuse_surfaces if coarse.two_surfaces else fuse_cells
        fuse_far(self.coarse, self.coarse_ticks, glrm_cells[away], values[away], ticks[away], coarse)
        if self.kept is not None:
            self.kept.forget(zip(*np.divmod(glrm_cells[away], self.glrm.cols), strict=True))
        if not within.any():
            return
        cells = self._fine_cells(blocks[within])
        each = self.factor**2
        self._fuse_fine(cells, np.repeat(values[within], each, axis=0), np.repeat(ticks[within], each), fine)
        self.rescale(cells)

    def fine(self) -> tuple[Grid, Values]:
        """All that was kept and the window, as one grid and its values; asserts `keep_fine`."""
        assert self.kept is not None and self.window is not None
        self.kept.keep((self.values, self.ticks, self.standing), self.window, np.ones_like(self.stale))
        return self.kept.assembled(self.glrm)

    @property
    def fine_blocks(self) -> tuple[int, int]:
        """Blocks from the first to the last row and column of what is kept and of the window; asserts `keep_fine`."""
        assert self.kept is not None and self.window is not None
        row, col = self.window
        first_row, first_col, end_row, end_col = self.kept.bounds() or (row, col, row, col)
        rows = max(end_row, row + self.blocks) - min(first_row, row)
        return rows, max(end_col, col + self.blocks) - min(first_col, col)

    def known_cells(self) -> Cells:
        """GLRM cells with any evidence, ascending."""
        told = self.coarse[:, [CONFIDENCE, CONFIDENCE_TOP, FREE_SHARE]] > 0
        return np.flatnonzero(told.any(axis=1))

    def _move(self, window: tuple[int, int], left: tuple[int, int] | None) -> None:
        """Every block of the new window is either kept or set from the coarse values, so nothing is cleared first."""
        entered, was_stale = np.ones_like(self.stale), self.stale.copy()
        if left is not None:
            moved, side = (window[0] - left[0], window[1] - left[1]), self.blocks * self.factor
            roll_into(entered, np.zeros_like(entered), moved)
            roll_into(self.stale, was_stale, moved)
            old, (values, ticks, standing) = (self.values, self.ticks, self.standing), self._spare
            if self.kept is not None:
                leaving = np.ones_like(self.stale)
                roll_into(leaving, np.zeros_like(leaving), (-moved[0], -moved[1]))
                self.kept.keep(old, left, leaving)
            moved = moved[0] * self.factor, moved[1] * self.factor
            roll_into(values.reshape(side, side, WIDTH), old[0].reshape(side, side, WIDTH), moved)
            roll_into(ticks.reshape(side, side), old[1].reshape(side, side), moved)
            roll_into(standing.reshape(side, side), old[2].reshape(side, side), moved)
            self.values, self.ticks, self.standing, self._spare = values, ticks, standing, old
        self.window = window
        blocks = np.flatnonzero(entered)
        inside, glrm_cells = self._glrm_cells(blocks)
        values, ticks = unknown_values(len(blocks)), np.zeros(len(blocks), np.uint32)
        values[inside], ticks[inside] = self.coarse[glrm_cells[inside]], self.coarse_ticks[glrm_cells[inside]]
        self._expand(blocks, values, ticks)
        if self.kept is not None:
            self.kept.put_back((self.values, self.ticks, self.standing), window, entered)

    def _expand(self, blocks: Cells, values: Values, ticks: Ticks) -> None:
        self.stale.reshape(-1)[blocks] = True
        side = self.blocks * self.factor
        expand_blocks(values, ticks, side, self.factor, blocks, self.values, self.ticks, self.standing)

    def _glrm_cells(self, blocks: Cells) -> tuple[Mask, Cells]:
        assert self.window is not None
        rows, cols = blocks // self.blocks + self.window[0], blocks % self.blocks + self.window[1]
        return self.glrm.contains(rows, cols), rows * self.glrm.cols + cols

    def _blocks(self, glrm_cells: Cells) -> tuple[Mask, Cells]:
        if self.window is None:
            return np.zeros(len(glrm_cells), np.bool_), glrm_cells
        rows, cols = glrm_cells // self.glrm.cols - self.window[0], glrm_cells % self.glrm.cols - self.window[1]
        within = (rows >= 0) & (rows < self.blocks) & (cols >= 0) & (cols < self.blocks)
        return within, rows * self.blocks + cols

    def _fine_cells(self, blocks: Cells) -> Cells:
        side, within = self.blocks * self.factor, np.arange(self.factor)
        firsts = (blocks // self.blocks) * self.factor * side + (blocks % self.blocks) * self.factor
        return (firsts[:, None, None] + within[:, None] * side + within).reshape(-1)
