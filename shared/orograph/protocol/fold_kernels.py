"""The compiled integer fold of GLRM cells (mapping.md sections 3 and 5); called through `protocol.fold` only."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt
from numba import njit

from orograph.arrays import I64
from orograph.messages import UNKNOWN_GRADIENT, UNKNOWN_OCCUPATION

Records = npt.NDArray[Any]
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
def _newer_wins(confidence_new: Whole, confidence_old: Whole, printed: bool) -> Whole:
    differs = (confidence_new if printed else abs(confidence_new - confidence_old)) > HIGH_DIFFERENCE
    if not differs and confidence_new >= HIGH_CONFIDENCE and confidence_old >= HIGH_CONFIDENCE:
        return True
    return confidence_new >= confidence_old


@njit(cache=True)
def _order_by_tick(registers: Records, i: Whole, order: I64) -> Whole:
    """Rows with evidence in column i, oldest first (rows already ascend by robot, the sort is stable); their number."""
    n = 0
    for k in range(registers.shape[0]):
        if registers[k, i].confidence == 0:
            continue
        j = n
        while j > 0 and registers[order[j - 1], i].tick > registers[k, i].tick:
            order[j] = order[j - 1]
            j -= 1
        order[j] = k
        n += 1
    return n


@njit(cache=True)
def fold_cells(
    prior: Records, registers: Records, half_life_ms: Whole, height_gate_mm: Whole, tangent_n: Whole, tangent_d: Whole,
    printed: bool, ageing: I64, out: Records,
) -> None:  # fmt: skip
    """Fold `registers` (robots, n), rows by robot number, confidence 0 is none, over `prior` (n,) into `out` (n,)."""
    order = np.empty(registers.shape[0], np.int64)
    for i in range(prior.shape[0]):
        height: Whole = np.int64(prior[i].height)
        slope_x: Whole = np.int64(prior[i].gradient_x)
        slope_y: Whole = np.int64(prior[i].gradient_y)
        occupation: Whole = np.int64(prior[i].occupation)
        confidence: Whole = np.int64(prior[i].confidence) * ONE
        n = _order_by_tick(registers, i, order)
        newest_tick = np.int64(registers[order[n - 1], i].tick) if n else 0
        for j in range(n):
            new = registers[order[j], i]
            weight = _aged(np.int64(new.confidence) * ONE, newest_tick - np.int64(new.tick), half_life_ms, ageing)
            if weight == 0:
                continue
            new_height, new_x, new_y = np.int64(new.height), np.int64(new.gradient_x), np.int64(new.gradient_y)
            new_occupation = np.int64(new.occupation)
            similar = (
                (height_gate_mm < 0 or abs(new_height - height) <= height_gate_mm)
                and _similar_slopes(slope_x, new_x, tangent_n, tangent_d)
                and _similar_slopes(slope_y, new_y, tangent_n, tangent_d)
            )
            if confidence > 0 and similar:
                height = _mean(height, confidence, new_height, weight)
                slope_x = _mean_of_known(slope_x, confidence, new_x, weight, UNKNOWN_GRADIENT)
                slope_y = _mean_of_known(slope_y, confidence, new_y, weight, UNKNOWN_GRADIENT)
                occupation = _mean_of_known(occupation, confidence, new_occupation, weight, UNKNOWN_OCCUPATION)
                confidence = min(CONFIDENCE_MAX, confidence + weight)
            elif confidence == 0 or _newer_wins(weight, confidence, printed):
                height, slope_x, slope_y, occupation, confidence = new_height, new_x, new_y, new_occupation, weight
        out[i].height, out[i].gradient_x, out[i].gradient_y = height, slope_x, slope_y
        out[i].occupation, out[i].confidence = occupation, (confidence + ONE // 2) // ONE
