"""Compiled: coarse values to registers, and which of them moved enough to be worth sending (mapping.md section 4)."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numba import njit

from orograph.messages import OCCUPATION_ONE, UNKNOWN_GRADIENT, UNKNOWN_OCCUPATION
from orograph.registers import GRADIENT_UNIT, HEIGHT_UNIT_M

HEIGHT_MOVED_MM = 100
OCCUPATION_MOVED = 0.1 * OCCUPATION_ONE
CONFIDENCE_MOVED = 16


@njit(cache=True)
def whole(value: float, lowest: float, highest: float, unknown: float) -> float:
    """Nearest whole number within bounds, halves away from zero; NaN becomes `unknown`."""
    if math.isnan(value):
        return unknown
    return min(max(math.copysign(math.floor(abs(value) + 0.5), value), lowest), highest)


@njit(cache=True, error_model="numpy")
def pack_cells(cells: Any, values: Any, ticks: Any, records: Any) -> None:
    """Set `records` (k,) UPDATE, zeros before, to `cells` (k,) of values (n, 5) and ticks (n,): `registers.pack`."""
    for i in range(cells.shape[0]):
        own, record = values[cells[i]], records[i]
        record.cell, record.tick = cells[i], ticks[cells[i]]
        record.height = np.int32(whole(own[0] / HEIGHT_UNIT_M, -(2.0**31), 2.0**31 - 1.0, 0.0))
        record.gradient_x = np.int16(whole(own[1] / GRADIENT_UNIT, -32767.0, 32767.0, UNKNOWN_GRADIENT))
        record.gradient_y = np.int16(whole(own[2] / GRADIENT_UNIT, -32767.0, 32767.0, UNKNOWN_GRADIENT))
        record.occupation = np.uint8(
            whole(np.float64(own[3]) * OCCUPATION_ONE, 0.0, OCCUPATION_ONE, UNKNOWN_OCCUPATION)
        )
        record.confidence = np.uint8(whole(np.float64(own[4]), 1.0, 255.0, 0.0))


@njit(cache=True)
def moved_enough(records: Any, held: Any) -> Any:
    """Mask (n,) of `records` (n,) of first sight, or away from `held` (one per cell) by more than a threshold."""
    mask = np.empty(records.shape[0], np.bool_)
    for i in range(records.shape[0]):
        new, old = records[i], held[records[i].cell]
        occupation, before = np.int64(new.occupation), np.int64(old.occupation)
        mask[i] = (
            old.confidence == 0
            or abs(np.int64(new.height) - np.int64(old.height)) > HEIGHT_MOVED_MM
            or (occupation == UNKNOWN_OCCUPATION) != (before == UNKNOWN_OCCUPATION)
            or abs(occupation - before) > OCCUPATION_MOVED
            or abs(np.int64(new.confidence) - np.int64(old.confidence)) > CONFIDENCE_MOVED
        )
    return mask
