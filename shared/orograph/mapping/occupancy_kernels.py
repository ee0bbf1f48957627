"""Compiled: what planning is told of the HRM, block by block and only where it changed."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numba import njit

from orograph.layers import CONFIDENCE, OCCUPATION, OCCUPATION_ONE, UNKNOWN_OCCUPATION, WALL_SHARE
from orograph.mapping.fusion_kernels import fuse_pair, real4

BARRED = OCCUPATION_ONE


@njit(cache=True)
def occupation_code(occupation: float) -> int:
    """Occupation in 1/254, halves up; NaN becomes 255."""
    return UNKNOWN_OCCUPATION if math.isnan(occupation) else math.floor(occupation * OCCUPATION_ONE + 0.5)


@njit(cache=True)
def surface_code(values: Any, cell: Any, told_code: Any) -> Any:
    """What was measured, where anything was: ground without a slope is free where it is told to be barred."""
    if values[cell, WALL_SHARE] <= 0.0 and values[cell, CONFIDENCE] <= 0.0:
        return told_code
    if math.isnan(values[cell, OCCUPATION]):
        return 0 if told_code >= BARRED else told_code
    return occupation_code(np.float64(values[cell, OCCUPATION]))


@njit(cache=True, error_model="numpy")
def planning_codes(
    values: Any, prior: Any, told: Any, glrm_shape: Any, window: Any, factor: int, rules: Any, stale: Any,
    told_codes: Any, codes: Any,
) -> None:  # fmt: skip
    """Occupation codes (rows, cols) of fine `values` (rows * cols, WIDTH) over coarse `prior`; of `told` where unknown.

    `window` is the (row, col) of the fine map's first block in the coarse `prior` (cells, WIDTH) and `told` (cells,) of
    `glrm_shape`. A block that is `stale` (blocks,) is made anew; where only its code in `told_codes` (blocks,) is
    another now, its unknown cells are. Both are brought up to date in place.
    """
    cols = codes.shape[1]
    for block in range(stale.shape[0]):
        block_row = block // (cols // factor)
        block_col = block - block_row * (cols // factor)
        row, col = window[0] + block_row, window[1] + block_col
        inside = 0 <= row < glrm_shape[0] and 0 <= col < glrm_shape[1]
        told_code = told[row * glrm_shape[1] + col] if inside else np.uint8(UNKNOWN_OCCUPATION)
        known_too = stale[block]
        if not known_too and told_codes[block] == told_code:
            continue
        stale[block], told_codes[block] = False, told_code
        told_cell = row * glrm_shape[1] + col if inside else 0
        under, c_under = real4(prior, told_cell), np.float64(prior[told_cell, CONFIDENCE]) if inside else 0.0
        for r in range(block_row * factor, (block_row + 1) * factor):
            for c in range(block_col * factor, (block_col + 1) * factor):
                cell = np.uint64(r * cols + c)
                if rules.two_surfaces:
                    codes[r, c] = surface_code(values, cell, told_code)
                elif values[cell, CONFIDENCE] <= 0.0:
                    codes[r, c] = told_code
                elif known_too:
                    own, c_own = real4(values, cell), np.float64(values[cell, CONFIDENCE])
                    fused = fuse_pair(under, c_under, own, c_own, rules)
                    codes[r, c] = occupation_code(float(np.float32(fused[3])))


@njit(cache=True)
def bar_cells(codes: Any, cells: Any, rows: int, cols: int) -> None:
    """Bar in `codes` (side, side) these cells (k,) of a window that has moved by as many rows and cols, in place."""
    side = codes.shape[0]
    for i in range(cells.shape[0]):
        row = cells[i] // side
        r, c = row + rows, cells[i] - row * side + cols
        if 0 <= r < side and 0 <= c < side:
            codes[r, c] = BARRED
