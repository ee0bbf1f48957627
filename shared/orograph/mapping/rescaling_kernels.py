"""Compiled: blocks of fine cells to coarse cells and back (mapping.md section 4)."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numba import njit


@njit(cache=True)
def rescale_blocks(
    values: Any, ticks: Any, cols: int, factor: int, blocks: Any, coarse: Any, coarse_ticks: Any
) -> None:
    """Values (k, 5) and newest ticks (k,) of `blocks` (k,) of factor x factor fine cells of a map of `cols` columns.

    Confidence-weighted means over known cells; confidence is the sum over the number of cells.
    """
    block_cols = cols // factor
    total, weight = np.empty(4), np.empty(4)
    for i in range(blocks.shape[0]):
        first = (blocks[i] // block_cols) * factor * cols + (blocks[i] % block_cols) * factor
        total[:], weight[:] = 0.0, 0.0
        confidence, newest = 0.0, np.uint32(0)
        for row in range(factor):
            for cell in range(first + row * cols, first + row * cols + factor):
                own = values[cell]
                c = np.float64(own[4])
                if c <= 0.0:
                    continue
                confidence += c
                newest = max(newest, ticks[cell])
                for layer in range(4):
                    if not math.isnan(own[layer]):
                        total[layer] += c * own[layer]
                        weight[layer] += c
        for layer in range(4):
            coarse[i, layer] = total[layer] / weight[layer] if weight[layer] > 0.0 else math.nan
        coarse[i, 4] = confidence / (factor * factor)
        coarse_ticks[i] = newest


@njit(cache=True)
def expand_blocks(coarse: Any, coarse_ticks: Any, cols: int, factor: int, blocks: Any, values: Any, ticks: Any) -> None:
    """Set every fine cell of `blocks` (k,) to its block's coarse values (k, 5) and ticks (k,), in place."""
    block_cols = cols // factor
    for i in range(blocks.shape[0]):
        first = (blocks[i] // block_cols) * factor * cols + (blocks[i] % block_cols) * factor
        for row in range(factor):
            for cell in range(first + row * cols, first + row * cols + factor):
                values[cell] = coarse[i]
                ticks[cell] = coarse_ticks[i]


@njit(cache=True)
def blocks_of(cells: Any, cols: int, factor: int, marked: Any) -> Any:
    """The blocks that hold `cells`, ascending; `marked` (blocks,) is all False before and after."""
    block_cols = cols // factor
    for i in range(cells.shape[0]):
        row = cells[i] // cols
        marked[row // factor * block_cols + (cells[i] - row * cols) // factor] = True
    blocks = np.flatnonzero(marked)
    marked[blocks] = False
    return blocks
