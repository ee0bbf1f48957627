"""Compiled: what a scan does to the evidence of the rule set `surface` (mapping.md 7.2-4), cell by cell.

`standing` counts hits and misses of each fine cell: +1 where a scan shows a step, -1 where it shows flat ground, -0.2
for each ray that passes through while nothing is hit there, within +-5. Something stands where it is positive.
"""

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
from orograph.mapping.fusion_kernels import AGES_KEPT, fuse_pair, real4
from orograph.mapping.surface_kernels import FLAT, NEITHER, STEP

MISSED_BY_RAY = 0.2
MOST = 5.0
RUN = 256


@njit(cache=True)
def settle(values: Any, cell: Any, standing: float, slope_max: float) -> None:
    """Bring a fine cell's top, shares and occupation in line with its counter and ground, in place."""
    if standing > 0.0:
        values[cell, WALL_SHARE], values[cell, FREE_SHARE], values[cell, OCCUPATION] = 1.0, 0.0, 1.0
        return
    values[cell, HEIGHT_TOP], values[cell, CONFIDENCE_TOP], values[cell, WALL_SHARE] = math.nan, 0.0, 0.0
    values[cell, FREE_SHARE] = 1.0
    gx, gy = np.float64(values[cell, GRADIENT_X]), np.float64(values[cell, GRADIENT_Y])
    share = math.sqrt(gx * gx + gy * gy) / slope_max
    values[cell, OCCUPATION] = 1.0 if share > 1.0 else share


@njit(cache=True)
def put_ground(values: Any, cell: Any, ground: Any) -> None:
    """Set a cell's ground to what `fuse_pair` gave; occupation is not of the ground alone."""
    values[cell, HEIGHT], values[cell, GRADIENT_X], values[cell, GRADIENT_Y] = ground[0], ground[1], ground[2]
    values[cell, CONFIDENCE] = ground[4]


@njit(cache=True)
def fuse_ground(values: Any, cell: Any, c_held: float, incoming: Any, i: Any, rules: Any) -> None:
    """Fuse the ground of a newer `incoming[i]` into a cell whose confidence has decayed to `c_held`, in place."""
    came = real4(incoming, i)
    put_ground(values, cell, fuse_pair(real4(values, cell), c_held, came, np.float64(incoming[i, CONFIDENCE]), rules))


@njit(cache=True)
def raise_top(values: Any, cell: Any, incoming: Any, i: Any) -> None:
    """The top is at least as high as the highest of it that was seen; what is seen of it adds up."""
    c_held, came_m = values[cell, CONFIDENCE_TOP], incoming[i, HEIGHT_TOP]
    if not c_held > 0.0 or came_m > values[cell, HEIGHT_TOP]:
        values[cell, HEIGHT_TOP] = came_m
    values[cell, CONFIDENCE_TOP] = min(255.0, np.float64(c_held) + np.float64(incoming[i, CONFIDENCE_TOP]))


@njit(cache=True, error_model="numpy")
def fuse_scan(
    values: Any, ticks: Any, standing: Any, cells: Any, incoming: Any, kinds: Any, tick: Any, rules: Any
) -> None:
    """Fuse one scan's `incoming` (k, WIDTH) of `kinds` (k,) into the fine `cells` (k,) of values (n, WIDTH), in place.

    Both confidences of a cell decay to `tick` [ms] first; a tick of the past counts as now.
    """
    ages, decays = np.full(AGES_KEPT, -1, np.int64), np.empty(AGES_KEPT)
    for i in range(cells.shape[0]):
        cell = np.uint64(cells[i])
        age: Any = max(np.int64(tick) - np.int64(ticks[cell]), 0)
        place = (age // 100) % AGES_KEPT
        if ages[place] != age:
            ages[place], decays[place] = age, 2.0 ** (-age / rules.half_life_ms)
        values[cell, CONFIDENCE_TOP] *= decays[place]
        fuse_ground(values, cell, values[cell, CONFIDENCE] * decays[place], incoming, i, rules)
        ticks[cell] = max(ticks[cell], tick)
        count = standing[cell]
        if kinds[i] == STEP:
            standing[cell] = count = min(count + 1.0, MOST)
            if count > 0.0:
                raise_top(values, cell, incoming, i)
        elif kinds[i] == FLAT:
            standing[cell] = count = max(count - 1.0, -MOST)
        if kinds[i] != NEITHER or (count <= 0.0 and values[cell, CONFIDENCE] > 0.0):
            settle(values, cell, count, rules.slope_max)


@njit(cache=True)
def standing_cells(standing: Any, hit: Any) -> Any:
    """Cells in which something stands, ascending, but for those just `hit` (k,).

    Most stand nowhere: whole runs of them are passed over by their signs, as whole numbers, many at once.
    """
    found, n = np.empty(standing.shape[0] + 1, np.int64), np.uint64(0)
    counts = standing[hit]
    standing[hit] = 0.0
    signs = standing.view(np.int32)
    for begin in range(0, standing.shape[0], RUN):
        run, most = signs[begin : begin + RUN], np.int32(0)
        for i in range(run.shape[0]):
            most = max(most, run[i])
        if most > 0:
            for i in range(run.shape[0]):
                found[n] = begin + i
                n += np.uint64(run[i] > 0)
    standing[hit] = counts
    return found[:n]


@njit(cache=True)
def clear_passed(values: Any, standing: Any, cells: Any, passes: Any, slope_max: float) -> Any:
    """Count the rays that passed (k,) against what stands in `cells` (k,), in place; returns the cells so freed."""
    freed, n = np.empty(cells.shape[0], np.int64), 0
    for i in range(cells.shape[0]):
        if passes[i] == 0:
            continue
        cell = cells[i]
        standing[cell] = max(standing[cell] - MISSED_BY_RAY * passes[i], -MOST)
        if standing[cell] <= 0.0:
            settle(values, cell, standing[cell], slope_max)
            freed[n] = cell
            n += 1
    return freed[:n]


@njit(cache=True, error_model="numpy")
def fuse_surfaces(values: Any, ticks: Any, cells: Any, incoming: Any, incoming_ticks: Any, rules: Any) -> None:
    """Fuse `incoming` (k, WIDTH) of an earlier life, or another level, into `values` (n, WIDTH) at `cells` (k,).

    Ground is fused; of what stands, the cell's own knowledge holds, and where it has none, what came.
    """
    for i in range(cells.shape[0]):
        cell = cells[i]
        if values[cell, CONFIDENCE] <= 0.0 and values[cell, WALL_SHARE] <= 0.0:
            values[cell] = incoming[i]
            ticks[cell] = incoming_ticks[i]
            continue
        age = np.int64(ticks[cell]) - np.int64(incoming_ticks[i])
        decay = 2.0 ** (-abs(age) / rules.half_life_ms)
        occupation = values[cell, OCCUPATION]
        if age <= 0:
            values[cell, CONFIDENCE_TOP] *= decay
            fuse_ground(values, cell, values[cell, CONFIDENCE] * decay, incoming, i, rules)
            ticks[cell] = incoming_ticks[i]
        elif incoming[i, CONFIDENCE] > 0.0:
            c_older, own = np.float64(np.float32(incoming[i, CONFIDENCE] * decay)), np.float64(values[cell, CONFIDENCE])
            put_ground(values, cell, fuse_pair(real4(incoming, i), c_older, real4(values, cell), own, rules))
        values[cell, OCCUPATION] = incoming[i, OCCUPATION] if math.isnan(occupation) else occupation


@njit(cache=True, error_model="numpy")
def lay_map_over(under: Any, own: Any, rules: Any, out: Any) -> None:
    """Own evidence (n, WIDTH) over the prior `under` it, into `out`: the prior gives way to what was measured.

    Of the prior's confidence there remains what it has more than the measurement.
    """
    for i in range(own.shape[0]):
        out[i] = own[i]
        left, c_own = np.float64(under[i, CONFIDENCE]), np.float64(own[i, CONFIDENCE])
        left -= max(c_own, 0.0)
        if left > 0.0:
            put_ground(out, i, fuse_pair(real4(under, i), left, real4(own, i), c_own, rules))
        if own[i, WALL_SHARE] > 0.0 or own[i, FREE_SHARE] > 0.0:
            if math.isnan(own[i, OCCUPATION]):
                gx, gy = np.float64(out[i, GRADIENT_X]), np.float64(out[i, GRADIENT_Y])
                share = math.sqrt(gx * gx + gy * gy) / rules.slope_max
                out[i, OCCUPATION] = 0.0 if math.isnan(share) else min(1.0, share)  # flat, without a slope
            continue
        for k in (HEIGHT_TOP, CONFIDENCE_TOP, WALL_SHARE, FREE_SHARE, OCCUPATION):
            out[i, k] = under[i, k]
