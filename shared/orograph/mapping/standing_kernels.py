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
from orograph.mapping.fusion_kernels import AGES_KEPT, fuse_pair
from orograph.mapping.surface_kernels import FLAT, NEITHER, STEP

MISSED_BY_RAY = 0.2
MOST = 5.0
RUN = 256


@njit(cache=True)
def settle(held: Any, standing: float, slope_max: float) -> None:
    """Bring a fine cell's top, shares and occupation in line with its counter and ground, in place."""
    if standing > 0.0:
        held[WALL_SHARE], held[FREE_SHARE], held[OCCUPATION] = 1.0, 0.0, 1.0
        return
    held[HEIGHT_TOP], held[CONFIDENCE_TOP], held[WALL_SHARE] = math.nan, 0.0, 0.0
    held[FREE_SHARE] = 1.0
    gx, gy = np.float64(held[GRADIENT_X]), np.float64(held[GRADIENT_Y])
    share = math.sqrt(gx * gx + gy * gy) / slope_max
    held[OCCUPATION] = 1.0 if share > 1.0 else share


@njit(cache=True)
def fuse_ground(held: Any, c_held: float, came: Any, rules: Any) -> None:
    """Fuse the ground of a newer cell into `held`, whose confidence has decayed to `c_held`, in place."""
    ground = fuse_pair(held, c_held, came, np.float64(came[CONFIDENCE]), rules)
    held[HEIGHT], held[GRADIENT_X], held[GRADIENT_Y], _, held[CONFIDENCE] = ground


@njit(cache=True)
def raise_top(held: Any, came: Any) -> None:
    """The top is at least as high as the highest of it that was seen; what is seen of it adds up."""
    if not held[CONFIDENCE_TOP] > 0.0 or came[HEIGHT_TOP] > held[HEIGHT_TOP]:
        held[HEIGHT_TOP] = came[HEIGHT_TOP]
    held[CONFIDENCE_TOP] = min(255.0, np.float64(held[CONFIDENCE_TOP]) + np.float64(came[CONFIDENCE_TOP]))


@njit(cache=True, error_model="numpy")
def fuse_scan(
    values: Any, ticks: Any, standing: Any, cells: Any, incoming: Any, kinds: Any, tick: Any, rules: Any
) -> None:
    """Fuse one scan's `incoming` (k, WIDTH) of `kinds` (k,) into the fine `cells` (k,) of values (n, WIDTH), in place.

    Both confidences of a cell decay to `tick` [ms] first; a tick of the past counts as now.
    """
    ages, decays = np.full(AGES_KEPT, -1, np.int64), np.empty(AGES_KEPT)
    for i in range(cells.shape[0]):
        cell = cells[i]
        held, came = values[cell], incoming[i]
        age: Any = max(np.int64(tick) - np.int64(ticks[cell]), 0)
        place = (age // 100) % AGES_KEPT
        if ages[place] != age:
            ages[place], decays[place] = age, 2.0 ** (-age / rules.half_life_ms)
        held[CONFIDENCE_TOP] *= decays[place]
        fuse_ground(held, held[CONFIDENCE] * decays[place], came, rules)
        ticks[cell] = max(ticks[cell], tick)
        if kinds[i] == STEP:
            standing[cell] = min(standing[cell] + 1.0, MOST)
            if standing[cell] > 0.0:
                raise_top(held, came)
        elif kinds[i] == FLAT:
            standing[cell] = max(standing[cell] - 1.0, -MOST)
        if kinds[i] != NEITHER or (standing[cell] <= 0.0 and held[CONFIDENCE] > 0.0):
            settle(held, standing[cell], rules.slope_max)


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
            settle(values[cell], standing[cell], slope_max)
            freed[n] = cell
            n += 1
    return freed[:n]


@njit(cache=True, error_model="numpy")
def fuse_surfaces(values: Any, ticks: Any, cells: Any, incoming: Any, incoming_ticks: Any, rules: Any) -> None:
    """Fuse `incoming` (k, WIDTH) of an earlier life, or another level, into `values` (n, WIDTH) at `cells` (k,).

    Ground is fused; of what stands, the cell's own knowledge holds, and where it has none, what came.
    """
    for i in range(cells.shape[0]):
        held, came, cell = values[cells[i]], incoming[i], cells[i]
        if held[CONFIDENCE] <= 0.0 and held[WALL_SHARE] <= 0.0:
            held[:] = came
            ticks[cell] = incoming_ticks[i]
            continue
        age = np.int64(ticks[cell]) - np.int64(incoming_ticks[i])
        decay = 2.0 ** (-abs(age) / rules.half_life_ms)
        occupation = held[OCCUPATION]
        if age <= 0:
            held[CONFIDENCE_TOP] *= decay
            fuse_ground(held, held[CONFIDENCE] * decay, came, rules)
            ticks[cell] = incoming_ticks[i]
        elif came[CONFIDENCE] > 0.0:
            older = came.copy()
            older[CONFIDENCE] *= decay
            own = np.float64(held[CONFIDENCE])
            ground = fuse_pair(older, np.float64(older[CONFIDENCE]), held, own, rules)
            held[HEIGHT], held[GRADIENT_X], held[GRADIENT_Y], _, held[CONFIDENCE] = ground
        held[OCCUPATION] = came[OCCUPATION] if math.isnan(occupation) else occupation


@njit(cache=True, error_model="numpy")
def lay_over(under: Any, own: Any, rules: Any, out: Any) -> None:
    """A cell's own evidence over the prior `under` it, into `out` (WIDTH,): the prior gives way to what was measured.

    Of the prior's confidence there remains what it has more than the measurement.
    """
    out[:] = own
    left = np.float64(under[CONFIDENCE]) - max(np.float64(own[CONFIDENCE]), 0.0)
    if left > 0.0:
        ground = fuse_pair(under, left, own, np.float64(own[CONFIDENCE]), rules)
        out[HEIGHT], out[GRADIENT_X], out[GRADIENT_Y], _, out[CONFIDENCE] = ground
    if own[WALL_SHARE] > 0.0 or own[FREE_SHARE] > 0.0:
        if math.isnan(own[OCCUPATION]):
            gx, gy = np.float64(out[GRADIENT_X]), np.float64(out[GRADIENT_Y])
            share = math.sqrt(gx * gx + gy * gy) / rules.slope_max
            out[OCCUPATION] = 0.0 if math.isnan(share) else min(1.0, share)  # flat, without a slope
        return
    out[HEIGHT_TOP], out[CONFIDENCE_TOP] = under[HEIGHT_TOP], under[CONFIDENCE_TOP]
    out[WALL_SHARE], out[FREE_SHARE], out[OCCUPATION] = under[WALL_SHARE], under[FREE_SHARE], under[OCCUPATION]


@njit(cache=True)
def lay_map_over(under: Any, own: Any, rules: Any, out: Any) -> None:
    """`lay_over` for maps (n, WIDTH)."""
    for i in range(own.shape[0]):
        lay_over(under[i], own[i], rules, out[i])
