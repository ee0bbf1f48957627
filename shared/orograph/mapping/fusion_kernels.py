"""Compiled: the one rule that fuses two cells (mapping.md section 3, Eq. 11-12), over many cells."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numba import njit

from orograph.layers import CONFIDENCE, GRADIENT_X, GRADIENT_Y, HEIGHT, OCCUPATION

HIGH = 128.0
"""Both at least this confident and still different: the environment has changed (8/16)."""
CLEAR_DIFFERENCE = 2.0 / 16.0 * 255.0
AGES_KEPT = 61
"""Powers remembered while a scan is fused: its cells differ in age by whole frames, which a prime spreads evenly."""


@njit(cache=True)
def same_slope(a: float, b: float, tan_similarity: float) -> bool:
    """|atan a - atan b| <= the similarity angle, by the tangent of the difference; unknown counts as similar.

    Slopes a right angle or more apart make the right side negative.
    """
    if math.isnan(a) or math.isnan(b):
        return True
    return abs(a - b) <= tan_similarity * (1.0 + a * b)


@njit(cache=True, error_model="numpy")
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
def real4(values: Any, cell: Any) -> Any:
    """(height, gradient_x, gradient_y, occupation) of one row of values (n, WIDTH), as float64.

    Rows are named by their number: numba would count the references of a view of one, which costs more than to fuse.
    """
    slopes = np.float64(values[cell, GRADIENT_X]), np.float64(values[cell, GRADIENT_Y])
    return np.float64(values[cell, HEIGHT]), slopes[0], slopes[1], np.float64(values[cell, OCCUPATION])


@njit(cache=True, error_model="numpy")
def fuse_pair(old: Any, c_old: float, new: Any, c_new: float, rules: Any) -> Any:
    """(height, gradient_x, gradient_y, occupation, confidence) of two cells as `real4`, confidences decayed already."""
    h1, gx1, gy1, o1 = old
    h2, gx2, gy2, o2 = new
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


@njit(cache=True, error_model="numpy")
def fuse_cells(values: Any, ticks: Any, cells: Any, incoming: Any, incoming_ticks: Any, rules: Any) -> None:
    """Fuse `incoming` (k, WIDTH) of ticks (k,) [ms] into `values` (n, WIDTH), `ticks` (n,) at `cells` (k,), in place.

    The older of two cells decays to the newer one's tick first; of equal ticks the incoming one counts as newer.
    """
    ages, decays = np.full(AGES_KEPT, -1, np.int64), np.empty(AGES_KEPT)
    for i in range(cells.shape[0]):
        cell = np.uint64(cells[i])
        c_held, c_came = np.float64(values[cell, CONFIDENCE]), np.float64(incoming[i, CONFIDENCE])
        age = np.int64(incoming_ticks[i]) - np.int64(ticks[cell])
        if c_held <= 0.0:
            for k in range(values.shape[1]):
                values[cell, k] = incoming[i, k]
            ticks[cell] = incoming_ticks[i]
            continue
        if c_came <= 0.0:
            continue
        place = abs(age) % AGES_KEPT
        if ages[place] != abs(age):
            ages[place], decays[place] = abs(age), 2.0 ** (-abs(age) / rules.half_life_ms)
        decay, held, came = decays[place], real4(values, cell), real4(incoming, i)
        if age >= 0:
            fused = fuse_pair(held, c_held * decay, came, c_came, rules)
            ticks[cell] = incoming_ticks[i]
        else:
            fused = fuse_pair(came, c_came * decay, held, c_held, rules)
        values[cell, HEIGHT], values[cell, GRADIENT_X], values[cell, GRADIENT_Y] = fused[0], fused[1], fused[2]
        values[cell, OCCUPATION], values[cell, CONFIDENCE] = fused[3], fused[4]
