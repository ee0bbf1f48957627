"""The compiled integer fold of GLRM cells (mapping.md sections 3 and 5); called through `protocol.fold`.

The fold of a cell is a chain of steps, one a contribution, which `protocol.explained` takes one by one and tells of.
They are inlined: a call per contribution costs a third of the time.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numba import njit

from orograph.arrays import I64
from orograph.layers import (
    CONFIDENCE,
    CONFIDENCE_TOP,
    FREE_SHARE,
    GRADIENT_X,
    GRADIENT_Y,
    HEIGHT,
    HEIGHT_TOP,
    OCCUPATION,
    OCCUPATION_ONE,
    SHARE_ONE,
    UNKNOWN_GRADIENT,
    UNKNOWN_HEIGHT,
    UNKNOWN_OCCUPATION,
    WALL_SHARE,
)
from orograph.rules import (
    FREE_SHARE_OPEN,
    FREE_SHARE_SEEN,
    OCCUPATION_DOUBTFUL,
    SHARE_HALF,
    TOP_SURE,
    WALL_SHARE_FEW,
    WALL_SHARE_RIM,
)  # fmt: skip

Whole = Any
"""A signed 64-bit integer; never mix in an unsigned one, numba would go to floating point."""

ONE = 256
"""Confidences are held in 1/256 inside the fold, so that ageing loses nothing worth naming."""
CONFIDENCE_MAX = 255 * ONE
HIGH_DIFFERENCE = 2 * CONFIDENCE_MAX // 16
"""2/16 of 255, exact in 1/256."""
HIGH_CONFIDENCE = 128 * ONE
FREE, RIM, SEEN, HALF, FEW_WALLS = (
    int(share * SHARE_ONE) for share in (FREE_SHARE_OPEN, WALL_SHARE_RIM, FREE_SHARE_SEEN, SHARE_HALF, WALL_SHARE_FEW)
)
DOUBTFUL = int(OCCUPATION_DOUBTFUL * OCCUPATION_ONE)
AGEING_STEPS = 256
"""Entries of the ageing table per half-life."""


@njit(cache=True)
def aged(confidence: Whole, age_ms: Whole, half_life_ms: Whole, ageing: I64) -> Whole:
    """What is left of a register's confidence, in 1/256."""
    confidence = confidence * ONE
    if half_life_ms == 0 or age_ms == 0:
        return confidence
    position = age_ms * AGEING_STEPS // half_life_ms
    halvings = position // AGEING_STEPS
    if halvings > 30:
        return 0
    shift = 16 + halvings
    return (confidence * ageing[position % AGEING_STEPS] + (1 << (shift - 1))) >> shift


@njit(cache=True)
def _mean(a: Whole, weight_a: Whole, b: Whole, weight_b: Whole) -> Whole:
    total = a * weight_a + b * weight_b
    weight = weight_a + weight_b
    size = (2 * abs(total) + weight) // (2 * weight)
    return size if total >= 0 else -size


@njit(cache=True)
def _mean_of_known(a: Whole, weight_a: Whole, b: Whole, weight_b: Whole, unknown: Whole) -> Whole:
    if a == unknown:
        return b
    if b == unknown:
        return a
    return _mean(a, weight_a, b, weight_b)


@njit(cache=True)
def _similar_slopes(a: Whole, b: Whole, tangent_n: Whole, tangent_d: Whole) -> Whole:
    if a == UNKNOWN_GRADIENT or b == UNKNOWN_GRADIENT:
        return True
    dot = 100_000_000 + a * b
    return dot > 0 and abs(a - b) * 10_000 * tangent_d <= tangent_n * dot


@njit(cache=True)
def newer_wins(confidence_old: Whole, confidence_new: Whole, printed: bool) -> Whole:
    """Which of two different cells stays (mapping.md 3.2)."""
    differs = (confidence_new if printed else abs(confidence_new - confidence_old)) > HIGH_DIFFERENCE
    if not differs and confidence_new >= HIGH_CONFIDENCE and confidence_old >= HIGH_CONFIDENCE:
        return True
    return confidence_new >= confidence_old


@njit(cache=True)
def _order_by_tick(registers: I64, ticks: I64, i: Whole, order: I64) -> Whole:
    """Rows with evidence in column i, oldest first (rows already ascend by robot, the sort is stable); their number."""
    n = 0
    for k in range(registers.shape[0]):
        if registers[k, i, CONFIDENCE] == 0 and registers[k, i, CONFIDENCE_TOP] == 0:
            continue
        j = n
        while j > 0 and ticks[order[j - 1], i] > ticks[k, i]:
            order[j] = order[j - 1]
            j -= 1
        order[j] = k
        n += 1
    return n


@njit(cache=True)
def similar(held: I64, new: I64, rules: Any) -> Whole:
    """Whether two cells count as the same surface (mapping.md 3.1)."""
    if rules.height_gate_mm >= 0 and abs(new[HEIGHT] - held[HEIGHT]) > rules.height_gate_mm:
        return False
    return _similar_slopes(held[GRADIENT_X], new[GRADIENT_X], rules.similar_n, rules.similar_d) and _similar_slopes(
        held[GRADIENT_Y], new[GRADIENT_Y], rules.similar_n, rules.similar_d
    )


class Folding(NamedTuple):
    """What the fold of two surfaces keeps beside a cell's values: weights so far, and what bars the cell."""

    ground: int
    top: int
    of_share: int
    of_slope: int
    barred: bool
    cleared: bool
    doubtful: bool


@njit(cache=True, inline="always")
def fuse_cell(held: I64, confidence: Whole, new: I64, weight: Whole, rules: Any) -> Whole:
    """Section 3 on all values of a contribution of this weight, into `held`; returns the confidence."""
    if weight == 0:
        return confidence
    if confidence > 0 and similar(held, new, rules):
        held[HEIGHT] = _mean(held[HEIGHT], confidence, new[HEIGHT], weight)
        for k, unknown in (
            (GRADIENT_X, UNKNOWN_GRADIENT),
            (GRADIENT_Y, UNKNOWN_GRADIENT),
            (OCCUPATION, UNKNOWN_OCCUPATION),
        ):
            held[k] = _mean_of_known(held[k], confidence, new[k], weight, unknown)
        return min(CONFIDENCE_MAX, confidence + weight)
    if confidence == 0 or newer_wins(confidence, weight, rules.printed):
        held[:] = new
        return weight
    return confidence


@njit(cache=True)
def fold_cells(prior: I64, registers: I64, ticks: I64, rules: Any, ageing: I64, out: I64) -> None:
    """Fold `registers` (robots, n, WIDTH) of `ticks` (robots, n) over `prior` (n, WIDTH) into `out` (n, WIDTH).

    Rows are by robot number; confidence 0 is none. `rules` are `WholeRules`.
    """
    order = np.empty(registers.shape[0], np.int64)
    for i in range(prior.shape[0]):
        held = out[i]
        held[:] = prior[i]
        confidence: Whole = held[CONFIDENCE] * ONE
        n = _order_by_tick(registers, ticks, i, order)
        newest_tick = ticks[order[n - 1], i] if n else 0
        for j in range(n):
            new = registers[order[j], i]
            weight = aged(new[CONFIDENCE], newest_tick - ticks[order[j], i], rules.half_life_ms, ageing)
            confidence = fuse_cell(held, confidence, new, weight, rules)
        held[CONFIDENCE] = (confidence + ONE // 2) // ONE


@njit(cache=True)
def _fuse_ground(held: I64, confidence: Whole, new: I64, weight: Whole, rules: Any) -> Whole:
    """Section 3 on height and gradients of two contributions, into `held`; returns the confidence."""
    if weight == 0:
        return confidence
    if confidence > 0 and similar(held, new, rules):
        held[HEIGHT] = _mean(held[HEIGHT], confidence, new[HEIGHT], weight)
        for k in (GRADIENT_X, GRADIENT_Y):
            held[k] = _mean_of_known(held[k], confidence, new[k], weight, UNKNOWN_GRADIENT)
        return min(CONFIDENCE_MAX, confidence + weight)
    if confidence == 0 or newer_wins(confidence, weight, rules.printed):
        held[HEIGHT], held[GRADIENT_X], held[GRADIENT_Y] = new[HEIGHT], new[GRADIENT_X], new[GRADIENT_Y]
        return weight
    return confidence


@njit(cache=True, inline="always")
def begin_surfaces(told: I64) -> Any:
    """The fold of two surfaces before any contribution, over the prior `told` (WIDTH,)."""
    none: Whole = np.int64(0)
    return Folding(none, none, none, none, told[WALL_SHARE] > 0 and told[OCCUPATION] == OCCUPATION_ONE, False, False)


@njit(cache=True, inline="always")
def fuse_surfaces(held: I64, so_far: Any, new: I64, weight: Whole, top_weight: Whole, rules: Any) -> Any:
    """One contribution of these weights into `held` (mapping.md 7.5): each surface, and what bars, on its own."""
    either = max(weight, top_weight)
    if either == 0:
        return so_far
    ground, top, of_share, of_slope, barred, cleared, doubtful = so_far
    ground = _fuse_ground(held, ground, new, weight, rules)
    for k in (WALL_SHARE, FREE_SHARE):
        held[k] = _mean(held[k], of_share, new[k], either)
    walls, free = new[WALL_SHARE], new[FREE_SHARE]
    open_ = 2 * free + min(walls, RIM) > 2 * FREE or (walls == 0 and free >= SEEN)
    sure = new[CONFIDENCE_TOP] >= TOP_SURE
    shows = not open_ and walls > 0 and (sure or walls > FEW_WALLS)
    barred = not open_ and (barred or (shows and sure and walls + free >= HALF))
    doubtful = not open_ and (doubtful or shows)
    if not shows:
        known = held[OCCUPATION] if of_slope > 0 else UNKNOWN_OCCUPATION
        held[OCCUPATION] = _mean_of_known(known, of_slope, new[OCCUPATION], weight, UNKNOWN_OCCUPATION)
        of_slope += weight
    if open_ and walls == 0:
        top, cleared = np.int64(0), True
    elif top_weight > 0:
        held[HEIGHT_TOP] = new[HEIGHT_TOP] if top == 0 else max(held[HEIGHT_TOP], new[HEIGHT_TOP])
        top, cleared = min(CONFIDENCE_MAX, top + top_weight), False
    return Folding(ground, top, of_share + either, of_slope, barred, cleared, doubtful)


@njit(cache=True, inline="always")
def end_surfaces(held: I64, so_far: Any, told: I64, rules: Any) -> None:
    """What remains of the prior `told` (WIDTH,) into `held`: of each confidence, what it has more than the robots."""
    ground, top, _, _, barred, cleared, doubtful = so_far
    left = told[CONFIDENCE] * ONE - ground
    if left > 0:
        ground = _fuse_ground(held, ground, told, left, rules)
    left = 0 if cleared else told[CONFIDENCE_TOP] * ONE - top
    if left > 0:
        held[HEIGHT_TOP] = told[HEIGHT_TOP] if top == 0 else _mean(held[HEIGHT_TOP], top, told[HEIGHT_TOP], left)
        top += left
    if top == 0:
        held[HEIGHT_TOP] = UNKNOWN_HEIGHT
    if barred:
        held[OCCUPATION] = OCCUPATION_ONE
    elif doubtful:
        held[OCCUPATION] = DOUBTFUL
    elif held[OCCUPATION] == UNKNOWN_OCCUPATION and told[OCCUPATION] < OCCUPATION_ONE:
        held[OCCUPATION] = told[OCCUPATION]
    held[CONFIDENCE], held[CONFIDENCE_TOP] = (ground + ONE // 2) // ONE, (top + ONE // 2) // ONE


@njit(cache=True)
def fold_surfaces(prior: I64, registers: I64, ticks: I64, rules: Any, ageing: I64, out: I64) -> None:
    """`fold_cells` for rules of two surfaces (mapping.md 7.2-3).

    The contributions are fused first; of the prior's confidence in a surface there remains what it has more than they.
    """
    order = np.empty(registers.shape[0], np.int64)
    for i in range(prior.shape[0]):
        held, told = out[i], prior[i]
        held[:] = told
        so_far = begin_surfaces(told)
        n = _order_by_tick(registers, ticks, i, order)
        newest_tick = ticks[order[n - 1], i] if n else 0
        for j in range(n):
            new = registers[order[j], i]
            age_ms = newest_tick - ticks[order[j], i]
            weight = aged(new[CONFIDENCE], age_ms, rules.half_life_ms, ageing)
            top_weight = aged(new[CONFIDENCE_TOP], age_ms, rules.half_life_ms, ageing)
            so_far = fuse_surfaces(held, so_far, new, weight, top_weight, rules)
        end_surfaces(held, so_far, told, rules)
