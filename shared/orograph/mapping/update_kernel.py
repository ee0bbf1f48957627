"""Compiled: which registers moved enough to be worth sending (mapping.md section 4)."""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import njit

from orograph.messages import OCCUPATION_ONE, UNKNOWN_OCCUPATION

HEIGHT_MOVED_MM = 100
OCCUPATION_MOVED = 0.1 * OCCUPATION_ONE
CONFIDENCE_MOVED = 16


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
