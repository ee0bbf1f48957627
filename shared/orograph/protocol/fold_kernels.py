"""The compiled integer fold of GLRM cells (mapping.md sections 3 and 5); called through `protocol.fold`.

The fold of a cell is a chain of steps, one a contribution, which `protocol.explained` takes one by one and tells of.
What they pass on are tuples of integers, which the compiler keeps in registers.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numba import njit

from orograph.arrays import I64
from orograph.layers import (
    OCCUPATION_ONE,
    SHARE_ONE,
    UNKNOWN_GRADIENT,
    UNKNOWN_HEIGHT,
    UNKNOWN_OCCUPATION,
)  # fmt: skip
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
Records = Any
"""Structured arrays with the fields of UPDATE."""

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


class Ground(NamedTuple):
    """What section 3 fuses, as signed 64-bit integers."""

    height: Whole
    gradient_x: Whole
    gradient_y: Whole
    occupation: Whole


class Cell(NamedTuple):
    """All that a cell holds, as signed 64-bit integers."""

    ground: Ground
    confidence: Whole
    height_top: Whole
    confidence_top: Whole
    wall_share: Whole
    free_share: Whole


@njit(cache=True)
def _ground(record: Any) -> Ground:
    """A record is read where it lies: to convert all of them first costs more than to fold them."""
    slopes = np.int64(record.gradient_x), np.int64(record.gradient_y)
    return Ground(np.int64(record.height), slopes[0], slopes[1], np.int64(record.occupation))


@njit(cache=True)
def _cell(record: Any) -> Cell:
    confidences = np.int64(record.confidence), np.int64(record.confidence_top)
    shares = np.int64(record.wall_share), np.int64(record.free_share)
    return Cell(_ground(record), confidences[0], np.int64(record.height_top), confidences[1], shares[0], shares[1])


@njit(cache=True)
def _put_ground(ground: Ground, confidence: Whole, record: Any) -> None:
    record.height, record.gradient_x, record.gradient_y = ground.height, ground.gradient_x, ground.gradient_y
    record.occupation, record.confidence = ground.occupation, confidence


@njit(cache=True)
def rounded(confidence: Whole) -> Whole:
    """A confidence in 1/256 as registers hold it."""
    return (confidence + ONE // 2) // ONE


@njit(cache=True)
def _order_by_tick(registers: Records, i: Whole, with_tops: bool, order: I64, ticks: I64) -> Whole:
    """Rows with evidence in column i, oldest first (rows already ascend by robot, the sort is stable); their number.

    Their ticks stand beside them in `ticks`.
    """
    n = 0
    for k in range(registers.shape[0]):
        new = registers[k, i]
        if new.confidence == 0 and not (with_tops and new.confidence_top > 0):
            continue
        j, tick = n, np.int64(new.tick)
        while j > 0 and ticks[j - 1] > tick:
            order[j], ticks[j] = order[j - 1], ticks[j - 1]
            j -= 1
        order[j], ticks[j] = k, tick
        n += 1
    return n


@njit(cache=True)
def similar(held: Ground, new: Ground, rules: Any) -> Whole:
    """Whether two cells count as the same surface (mapping.md 3.1)."""
    if rules.height_gate_mm >= 0 and abs(new.height - held.height) > rules.height_gate_mm:
        return False
    return _similar_slopes(held.gradient_x, new.gradient_x, rules.similar_n, rules.similar_d) and _similar_slopes(
        held.gradient_y, new.gradient_y, rules.similar_n, rules.similar_d
    )


@njit(cache=True)
def fuse_ground(held: Ground, confidence: Whole, new: Ground, weight: Whole, rules: Any) -> Any:
    """Section 3 on a contribution of this weight: what it and `held` become, and the confidence, in 1/256."""
    if weight == 0:
        return held, confidence
    if confidence > 0 and similar(held, new, rules):
        mean = Ground(
            _mean(held.height, confidence, new.height, weight),
            _mean_of_known(held.gradient_x, confidence, new.gradient_x, weight, UNKNOWN_GRADIENT),
            _mean_of_known(held.gradient_y, confidence, new.gradient_y, weight, UNKNOWN_GRADIENT),
            _mean_of_known(held.occupation, confidence, new.occupation, weight, UNKNOWN_OCCUPATION),
        )
        return mean, min(CONFIDENCE_MAX, confidence + weight)
    if confidence == 0 or newer_wins(confidence, weight, rules.printed):
        return new, weight
    return held, confidence


@njit(cache=True)
def fold_cells(prior: Records, registers: Records, rules: Any, ageing: I64, out: Records) -> None:
    """Fold `registers` (robots, n), rows by robot number, confidence 0 is none, over `prior` (n,) into `out` (n,).

    `rules` are `WholeRules`; `out` is zero before. Nothing is told of what stands.
    """
    order, ticks = np.empty(registers.shape[0], np.int64), np.empty(registers.shape[0], np.int64)
    for i in range(prior.shape[0]):
        held, confidence = _ground(prior[i]), np.int64(prior[i].confidence) * ONE
        n = _order_by_tick(registers, i, False, order, ticks)
        for j in range(n):
            new = registers[order[j], i]
            weight = aged(np.int64(new.confidence), ticks[n - 1] - ticks[j], rules.half_life_ms, ageing)
            held, confidence = fuse_ground(held, confidence, _ground(new), weight, rules)
        _put_ground(held, rounded(confidence), out[i])
        out[i].height_top = UNKNOWN_HEIGHT


class Folding(NamedTuple):
    """The fold of two surfaces so far: values, their weights in 1/256, and what bars the cell."""

    ground: Ground
    confidence: Whole
    height_top: Whole
    top: Whole
    wall_share: Whole
    free_share: Whole
    of_share: Whole
    occupation: Whole
    of_slope: Whole
    barred: bool
    cleared: bool
    doubtful: bool


@njit(cache=True)
def begin_surfaces(told: Cell) -> Any:
    """The fold of two surfaces before any contribution, over the prior `told`."""
    none: Whole = np.int64(0)
    occupation = told.ground.occupation
    barred = told.wall_share > 0 and occupation == OCCUPATION_ONE
    return Folding(
        told.ground, none, told.height_top, none, told.wall_share, told.free_share, none, occupation, none, barred,
        False, False,
    )  # fmt: skip


@njit(cache=True)
def fuse_surfaces(so_far: Folding, new: Cell, weight: Whole, top_weight: Whole, rules: Any) -> Any:
    """The fold after a contribution of these weights (mapping.md 7.5): each surface, and what bars, on its own."""
    either = max(weight, top_weight)
    if either == 0:
        return so_far
    _, _, height_top, top, wall_share, free_share, of_share, occupation, of_slope, barred, cleared, doubtful = so_far
    ground, confidence = fuse_ground(so_far.ground, so_far.confidence, new.ground, weight, rules)
    walls, free = new.wall_share, new.free_share
    wall_share, free_share = _mean(wall_share, of_share, walls, either), _mean(free_share, of_share, free, either)
    open_ = 2 * free + (walls if walls <= RIM else 0) > 2 * FREE or (walls == 0 and free >= SEEN)
    sure = new.confidence_top >= TOP_SURE
    shows = not open_ and walls > 0 and (sure or walls > FEW_WALLS)
    barred = not open_ and (barred or (shows and sure and walls + free >= HALF))
    doubtful = not open_ and (doubtful or shows)
    if not shows:
        known = occupation if of_slope > 0 else UNKNOWN_OCCUPATION
        occupation = _mean_of_known(known, of_slope, new.ground.occupation, weight, UNKNOWN_OCCUPATION)
        of_slope += weight
    if open_ and walls == 0:
        top, cleared = np.int64(0), True
    elif top_weight > 0:
        height_top = new.height_top if top == 0 else max(height_top, new.height_top)
        top, cleared = min(CONFIDENCE_MAX, top + top_weight), False
    return Folding(
        ground, confidence, height_top, top, wall_share, free_share, of_share + either, occupation, of_slope, barred,
        cleared, doubtful,
    )  # fmt: skip


@njit(cache=True)
def end_surfaces(so_far: Folding, told: Cell, rules: Any) -> Any:
    """The cell with what remains of the prior `told`: of each confidence, what it has more than the robots."""
    ground, confidence, occupation = so_far.ground, so_far.confidence, so_far.occupation
    height_top, top = so_far.height_top, so_far.top
    left = told.confidence * ONE - confidence
    if left > 0:
        ground, confidence = fuse_ground(ground, confidence, told.ground, left, rules)
    left = 0 if so_far.cleared else told.confidence_top * ONE - top
    if left > 0:
        height_top = told.height_top if top == 0 else _mean(height_top, top, told.height_top, left)
        top += left
    if top == 0:
        height_top = UNKNOWN_HEIGHT
    if so_far.barred:
        occupation = OCCUPATION_ONE
    elif so_far.doubtful:
        occupation = DOUBTFUL
    elif occupation == UNKNOWN_OCCUPATION and told.ground.occupation < OCCUPATION_ONE:
        occupation = told.ground.occupation
    ground = Ground(ground.height, ground.gradient_x, ground.gradient_y, occupation)
    return Cell(ground, rounded(confidence), height_top, rounded(top), so_far.wall_share, so_far.free_share)


@njit(cache=True)
def fold_surfaces(prior: Records, registers: Records, rules: Any, ageing: I64, out: Records) -> None:
    """`fold_cells` for rules of two surfaces (mapping.md 7.2-3).

    The contributions are fused first; of the prior's confidence in a surface there remains what it has more than they.
    """
    order, ticks = np.empty(registers.shape[0], np.int64), np.empty(registers.shape[0], np.int64)
    for i in range(prior.shape[0]):
        told = _cell(prior[i])
        so_far = begin_surfaces(told)
        n = _order_by_tick(registers, i, True, order, ticks)
        for j in range(n):
            new, age_ms = _cell(registers[order[j], i]), ticks[n - 1] - ticks[j]
            weight = aged(new.confidence, age_ms, rules.half_life_ms, ageing)
            top_weight = aged(new.confidence_top, age_ms, rules.half_life_ms, ageing)
            so_far = fuse_surfaces(so_far, new, weight, top_weight, rules)
        cell = end_surfaces(so_far, told, rules)
        _put_ground(cell.ground, cell.confidence, out[i])
        out[i].height_top, out[i].confidence_top = cell.height_top, cell.confidence_top
        out[i].wall_share, out[i].free_share = cell.wall_share, cell.free_share
