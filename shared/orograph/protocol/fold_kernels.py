"""The compiled integer fold of GLRM cells (mapping.md sections 3 and 5); called through `protocol.fold` only."""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import njit

from orograph.arrays import I64
from orograph.layers import (
    CONFIDENCE,
    GRADIENT_X,
    GRADIENT_Y,
    HEIGHT,
    OCCUPATION,
    UNKNOWN_GRADIENT,
    UNKNOWN_OCCUPATION,
)

Whole = Any
"""A signed 64-bit integer; never mix in an unsigned one, numba would go to floating point."""

ONE = 256
"""Confidences are held in 1/256 inside the fold, so that ageing loses nothing worth naming."""
CONFIDENCE_MAX = 255 * ONE
HIGH_DIFFERENCE = 2 * CONFIDENCE_MAX // 16
"""2/16 of 255, exact in 1/256."""
HIGH_CONFIDENCE = 128 * ONE
AGEING_STEPS = 256
"""Entries of the ageing table per half-life."""


@njit(cache=True)
def _aged(confidence: Whole, age_ms: Whole, half_life_ms: Whole, ageing: I64) -> Whole:
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
def _newer_wins(confidence_old: Whole, confidence_new: Whole, printed: bool) -> Whole:
    differs = (confidence_new if printed else abs(confidence_new - confidence_old)) > HIGH_DIFFERENCE
    if not differs and confidence_new >= HIGH_CONFIDENCE and confidence_old >= HIGH_CONFIDENCE:
        return True
    return confidence_new >= confidence_old


@njit(cache=True)
def _order_by_tick(registers: I64, ticks: I64, i: Whole, order: I64) -> Whole:
    """Rows with evidence in column i, oldest first (rows already ascend by robot, the sort is stable); their number."""
    n = 0
    for k in range(registers.shape[0]):
        if registers[k, i, CONFIDENCE] == 0:
            continue
        j = n
        while j > 0 and ticks[order[j - 1], i] > ticks[k, i]:
            order[j] = order[j - 1]
            j -= 1
        order[j] = k
        n += 1
    return n


@njit(cache=True)
def _similar(held: I64, new: I64, rules: Any) -> Whole:
    if rules.height_gate_mm >= 0 and abs(new[HEIGHT] - held[HEIGHT]) > rules.height_gate_mm:
        return False
    return _similar_slopes(held[GRADIENT_X], new[GRADIENT_X], rules.similar_n, rules.similar_d) and _similar_slopes(
        held[GRADIENT_Y], new[GRADIENT_Y], rules.similar_n, rules.similar_d
    )


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
            age_ms = newest_tick - ticks[order[j], i]
            weight = _aged(new[CONFIDENCE] * ONE, age_ms, rules.half_life_ms, ageing)
            if weight == 0:
                continue
            if confidence > 0 and _similar(held, new, rules):
                held[HEIGHT] = _mean(held[HEIGHT], confidence, new[HEIGHT], weight)
                for k, unknown in (
                    (GRADIENT_X, UNKNOWN_GRADIENT),
                    (GRADIENT_Y, UNKNOWN_GRADIENT),
                    (OCCUPATION, UNKNOWN_OCCUPATION),
                ):
                    held[k] = _mean_of_known(held[k], confidence, new[k], weight, unknown)
                confidence = min(CONFIDENCE_MAX, confidence + weight)
            elif confidence == 0 or _newer_wins(confidence, weight, rules.printed):
                held[:] = new
                confidence = weight
        held[CONFIDENCE] = (confidence + ONE // 2) // ONE
