"""Compiled: the one rule that fuses two cells (mapping.md section 3, Eq. 11-12), over many cells and for planning."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numba import njit

from orograph.messages import OCCUPATION_ONE, UNKNOWN_OCCUPATION

HIGH = 128.0
"""Both at least this confident and still different: the environment has changed (8/16)."""
CLEAR_DIFFERENCE = 2.0 / 16.0 * 255.0


@njit(cache=True)
def same_slope(a: float, b: float, tan_similarity: float) -> bool:
    """|atan a - atan b| <= the similarity angle, by the tangent of the difference; unknown counts as similar.

    Slopes a right angle or more apart make the right side negative.
    """
    if math.isnan(a) or math.isnan(b):
        return True
    return abs(a - b) <= tan_similarity * (1.0 + a * b)


@njit(cache=True)
def weighted(a: float, ca: float, b: float, cb: float) -> float:
    """Eq. 11; a value known on one side only is taken from that side."""
    if math.isnan(a):
        return b
    if math.isnan(b):
        return a
    return (a * ca + b * cb) / (ca + cb)


@njit(cache=True)
def newer_wins(c_old: float, c_new: float, printed: bool) -> bool:
    """Which of two different cells stays (Eq. 12 as read, or as printed)."""
    clear = c_new > CLEAR_DIFFERENCE if printed else abs(c_new - c_old) > CLEAR_DIFFERENCE
    if not clear and c_old >= HIGH and c_new >= HIGH:
        return True
    return c_new >= c_old


@njit(cache=True)
def fuse_pair(old: Any, c_old: float, new: Any, c_new: float, rules: Any) -> Any:
    """(height, gradient_x, gradient_y, occupation, confidence) of two cells, confidences decayed already."""
    h1, gx1, gy1, o1 = np.float64(old[0]), np.float64(old[1]), np.float64(old[2]), np.float64(old[3])
    h2, gx2, gy2, o2 = np.float64(new[0]), np.float64(new[1]), np.float64(new[2]), np.float64(new[3])
    if c_new <= 0.0:
        return h1, gx1, gy1, o1, c_old
    if c_old <= 0.0:
        return h2, gx2, gy2, o2, c_new
    apart = abs(h1 - h2) > rules.height_gate_m
    if apart or not (same_slope(gx1, gx2, rules.tan_similarity) and same_slope(gy1, gy2, rules.tan_similarity)):
        if newer_wins(c_old, c_new, rules.printed):
            return h2, gx2, gy2, o2, c_new
        return h1, gx1, gy1, o1, c_old
    gx, gy = weighted(gx1, c_old, gx2, c_new), weighted(gy1, c_old, gy2, c_new)
    if math.isnan(rules.slope_max):
        occupation = weighted(o1, c_old, o2, c_new)
    else:
        share = math.sqrt(gx * gx + gy * gy) / rules.slope_max
        occupation = 1.0 if share > 1.0 else share
    return weighted(h1, c_old, h2, c_new), gx, gy, occupation, min(255.0, c_old + c_new)


@njit(cache=True)
def fuse_cells(values: Any, ticks: Any, cells: Any, incoming: Any, incoming_ticks: Any, rules: Any) -> None:
    """Fuse `incoming` (k, 5) of ticks (k,) [ms] into `values` (n, 5) and `ticks` (n,) at `cells` (k,), in place.

    The older of two cells decays to the newer one's tick first; of equal ticks the incoming one counts as newer.
    """
    last_age, decay = np.int64(0), 1.0
    for i in range(cells.shape[0]):
        held, came = values[cells[i]], incoming[i]
        age = np.int64(incoming_ticks[i]) - np.int64(ticks[cells[i]])
        if held[4] <= 0.0:
            held[:] = came
            ticks[cells[i]] = incoming_ticks[i]
            continue
        if came[4] <= 0.0:
            continue
        if abs(age) != last_age:
            last_age = abs(age)
            decay = 2.0 ** (-last_age / rules.half_life_ms)
        if age >= 0:
            fused = fuse_pair(held, held[4] * decay, came, np.float64(came[4]), rules)
            ticks[cells[i]] = incoming_ticks[i]
        else:
            fused = fuse_pair(came, came[4] * decay, held, np.float64(held[4]), rules)
        for layer in range(5):
            held[layer] = fused[layer]


@njit(cache=True)
def occupation_code(occupation: float) -> int:
    """Occupation in 1/254, halves up; NaN becomes 255."""
    return UNKNOWN_OCCUPATION if math.isnan(occupation) else math.floor(occupation * OCCUPATION_ONE + 0.5)


@njit(cache=True)
def planning_codes(
    values: Any, prior: Any, told: Any, glrm_shape: Any, window: Any, factor: int, rules: Any, codes: Any
) -> None:
    """Occupation codes (rows, cols) of fine `values` (rows * cols, 5) over coarse `prior`; of `told` where unknown.

    `window` is the (row, col) of the fine map's first block in the coarse maps (cells, 5) of `glrm_shape`.
    """
    rows, cols = codes.shape
    nothing = np.array([np.nan, np.nan, np.nan, np.nan, 0.0], np.float32)
    for block in range((rows // factor) * (cols // factor)):
        block_row = block // (cols // factor)
        block_col = block - block_row * (cols // factor)
        row, col = window[0] + block_row, window[1] + block_col
        inside = 0 <= row < glrm_shape[0] and 0 <= col < glrm_shape[1]
        under = prior[row * glrm_shape[1] + col] if inside else nothing
        told_code = occupation_code(told[row * glrm_shape[1] + col, 3]) if inside else UNKNOWN_OCCUPATION
        for r in range(block_row * factor, (block_row + 1) * factor):
            for c in range(block_col * factor, (block_col + 1) * factor):
                own = values[r * cols + c]
                if own[4] <= 0.0:
                    codes[r, c] = told_code
                    continue
                fused = fuse_pair(under, np.float64(under[4]), own, np.float64(own[4]), rules)
                codes[r, c] = occupation_code(float(np.float32(fused[3])))
