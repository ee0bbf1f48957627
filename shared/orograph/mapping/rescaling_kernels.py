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
    top, of_top, seen_top, walls, free = math.nan, 0.0, 0, 0.0, 0.0
    confidence, newest = 0.0, np.uint32(0)
    height = gradient_x = gradient_y = occupation = 0.0
    of_height = of_x = of_y = of_occupation = 0.0
    for row in range(factor):
        for cell in range(first + row * cols, first + row * cols + factor):
            wall = np.float64(values[cell, WALL_SHARE])
            walls, free = walls + wall, free + np.float64(values[cell, FREE_SHARE])
            if values[cell, CONFIDENCE_TOP] > 0.0:
                of_top, seen_top = of_top + np.float64(values[cell, CONFIDENCE_TOP]), seen_top + 1
                top = np.float64(values[cell, HEIGHT_TOP]) if math.isnan(top) else max(top, values[cell, HEIGHT_TOP])
                newest = max(newest, ticks[cell])
            c = np.float64(values[cell, CONFIDENCE])
            if c <= 0.0 or wall >= 1.0:
                continue
            h, gx = values[cell, HEIGHT], values[cell, GRADIENT_X]
            gy, o = values[cell, GRADIENT_Y], values[cell, OCCUPATION]
            confidence += c
            newest = max(newest, ticks[cell])
            height, of_height = (height, of_height) if math.isnan(h) else (height + c * h, of_height + c)
            gradient_x, of_x = (gradient_x, of_x) if math.isnan(gx) else (gradient_x + c * gx, of_x + c)
            gradient_y, of_y = (gradient_y, of_y) if math.isnan(gy) else (gradient_y + c * gy, of_y + c)
            if not math.isnan(o):
                occupation, of_occupation = occupation + c * o, of_occupation + c
            elif values[cell, FREE_SHARE] > 0.0:
                of_occupation += c  # flat, and too little of it seen to have a slope
    coarse[HEIGHT], coarse[GRADIENT_X] = height / of_height, gradient_x / of_x  # 0 / 0: unknown in every cell
    coarse[GRADIENT_Y], coarse[OCCUPATION] = gradient_y / of_y, occupation / of_occupation
    size = factor * factor
    coarse[CONFIDENCE], coarse[WALL_SHARE], coarse[FREE_SHARE] = confidence / size, walls / size, free / size
    coarse[HEIGHT_TOP], coarse[CONFIDENCE_TOP] = top, of_top / max(seen_top, 1)
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
