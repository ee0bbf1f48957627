"""Compiled: blocks of fine cells to coarse cells and back (mapping.md section 4)."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numba import njit

from orograph.layers import (
    CONFIDENCE,
    CONFIDENCE_TOP,
    FREE_SHARE,
    GRADIENT_X,
    GRADIENT_Y,
    HEIGHT,
    HEIGHT_TOP,
    OCCUPATION,
    WALL_SHARE,
)
from orograph.rules import (
    FREE_SHARE_OPEN,
    OCCUPATION_DOUBTFUL,
    SHARE_HALF,
    TOP_SURE,
    WALL_SHARE_FEW,
    WALL_SHARE_RIM,
)  # fmt: skip

FEW = 0.1
"""A cell that only its block says stands: the first look decides."""


@njit(cache=True, error_model="numpy")
def rescale_block(values: Any, ticks: Any, cols: int, factor: int, first: int, coarse: Any) -> Any:
    """Set `coarse` (WIDTH,) from the factor x factor fine cells from cell `first` on; returns their newest tick.

    Confidence-weighted means over cells of known ground; confidence is the sum over the number of cells. Of what stands
    the highest top, the mean confidence over the cells that show one, and the shares of the block; a block whose walls
    leave no more than FREE_SHARE_OPEN of it free is barred.
    """
    top: Any = -math.inf
    of_top, seen_top, walls, free = 0.0, 0, 0.0, 0.0
    confidence, newest = 0.0, np.uint32(0)
    height = gradient_x = gradient_y = occupation = 0.0
    of_height = of_x = of_y = of_occupation = 0.0
    for row in range(factor):
        begin = first + row * cols
        for at in range(begin, begin + factor):
            cell = np.uint64(at)
            wall, free_too = np.float64(values[cell, WALL_SHARE]), np.float64(values[cell, FREE_SHARE])
            walls, free = walls + wall, free + free_too
            c_top, c = np.float64(values[cell, CONFIDENCE_TOP]), np.float64(values[cell, CONFIDENCE])
            if c_top > 0.0:
                of_top, seen_top = of_top + c_top, seen_top + 1
                top, newest = max(top, np.float64(values[cell, HEIGHT_TOP])), max(newest, ticks[cell])
            if c <= 0.0 or wall >= 1.0:
                continue
            newest = max(newest, ticks[cell])
            h, gx = np.float64(values[cell, HEIGHT]), np.float64(values[cell, GRADIENT_X])
            gy, o = np.float64(values[cell, GRADIENT_Y]), np.float64(values[cell, OCCUPATION])
            confidence += c
            height, of_height = height + (c * h if h == h else 0.0), of_height + (c if h == h else 0.0)
            gradient_x, of_x = gradient_x + (c * gx if gx == gx else 0.0), of_x + (c if gx == gx else 0.0)
            gradient_y, of_y = gradient_y + (c * gy if gy == gy else 0.0), of_y + (c if gy == gy else 0.0)
            # Flat, and too little of it seen to have a slope: no occupation, but not nothing.
            flat = (o != o) & (free_too > 0.0)
            occupation += c * o if o == o else 0.0
            of_occupation += c if (o == o) | flat else 0.0
    coarse[HEIGHT], coarse[GRADIENT_X] = height / of_height, gradient_x / of_x  # 0 / 0: unknown in every cell
    coarse[GRADIENT_Y], coarse[OCCUPATION] = gradient_y / of_y, occupation / of_occupation
    size = factor * factor
    coarse[CONFIDENCE], coarse[WALL_SHARE], coarse[FREE_SHARE] = confidence / size, walls / size, free / size
    coarse[HEIGHT_TOP], coarse[CONFIDENCE_TOP] = top if seen_top else math.nan, of_top / max(seen_top, 1)
    sure = coarse[CONFIDENCE_TOP] >= TOP_SURE
    shows = walls > 0.0 and (sure or walls > WALL_SHARE_FEW * size)
    rim = walls if walls <= WALL_SHARE_RIM * size else 0.0
    if shows and free + rim / 2.0 <= FREE_SHARE_OPEN * size:
        coarse[OCCUPATION] = 1.0 if sure and walls + free >= SHARE_HALF * size else OCCUPATION_DOUBTFUL
    return newest


@njit(cache=True)
def rescale_map(values: Any, cols: int, factor: int, coarse: Any) -> None:
    """Values (k, WIDTH) of all blocks of a map (n, WIDTH) of `cols` columns, row by row."""
    no_ticks = np.zeros(values.shape[0], np.uint32)
    block_cols = cols // factor
    for block in range(coarse.shape[0]):
        first = (block // block_cols) * factor * cols + (block % block_cols) * factor
        rescale_block(values, no_ticks, cols, factor, first, coarse[block])


@njit(cache=True)
def mark_blocks(cells: Any, block_of_cell: Any, marked: Any, marked_too: Any) -> None:
    """Mark the blocks of fine `cells` (k,) in two masks (blocks,)."""
    for i in range(cells.shape[0]):
        block = block_of_cell[cells[i]]
        marked[block] = marked_too[block] = True


@njit(cache=True)
def rescale_marked(
    values: Any, ticks: Any, blocks: int, factor: int, window: Any, glrm_shape: Any, marked: Any, coarse: Any,
    coarse_ticks: Any,
) -> Any:  # fmt: skip
    """Bring the coarse cells under `marked` (blocks * blocks,) up to date, in place; returns them, ascending.

    `window` is the GLRM (row, col) of the fine map's first block. All marks are cleared; blocks outside the GLRM have
    no coarse cell.
    """
    touched, count, cols = np.empty(marked.shape[0], np.int64), 0, blocks * factor
    for block in range(marked.shape[0]):
        if not marked[block]:
            continue
        marked[block] = False
        block_row = block // blocks
        block_col = block - block_row * blocks
        row, col = window[0] + block_row, window[1] + block_col
        if not (0 <= row < glrm_shape[0] and 0 <= col < glrm_shape[1]):
            continue
        cell = row * glrm_shape[1] + col
        first = block_row * factor * cols + block_col * factor
        coarse_ticks[cell] = rescale_block(values, ticks, cols, factor, first, coarse[cell])
        touched[count] = cell
        count += 1
    return touched[:count]


@njit(cache=True)
def expand_blocks(
    coarse: Any, coarse_ticks: Any, cols: int, factor: int, blocks: Any, values: Any, ticks: Any, standing: Any
) -> None:
    """Set every fine cell of `blocks` (k,) to its block's coarse values (k, WIDTH) and ticks (k,), in place.

    Where of a block something stands is forgotten: a first look decides.
    """
    block_cols = cols // factor
    for i in range(blocks.shape[0]):
        first = (blocks[i] // block_cols) * factor * cols + (blocks[i] % block_cols) * factor
        for row in range(factor):
            for cell in range(first + row * cols, first + row * cols + factor):
                values[cell] = coarse[i]
                ticks[cell] = coarse_ticks[i]
                standing[cell] = FEW if coarse[i, WALL_SHARE] > 0.0 else 0.0
