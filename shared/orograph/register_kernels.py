"""Compiled: values to the whole numbers of registers, and which of these moved enough to be worth sending."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numba import njit


@njit(cache=True, error_model="numpy")
def whole_numbers(values: Any, step: Any, lowest: Any, highest: Any, unknown: Any) -> Any:
    """Whole numbers (n, k) of `step` (k,) nearest to values (n, k), halves away from zero, within bounds.

    NaN becomes `unknown`, and nothing stays nothing: the one rounding of the project.
    """
    whole = np.empty(values.shape, np.int64)
    for i in range(values.shape[0]):
        for k in range(values.shape[1]):
            steps = np.float64(values[i, k]) / step[k]
            nearest = math.copysign(math.floor(abs(steps) + 0.5), steps)
            if math.isnan(steps) or steps == 0.0:
                whole[i, k] = 0 if steps == 0.0 else unknown[k]
            else:
                whole[i, k] = np.int64(min(max(nearest, lowest[k]), highest[k]))
    return whole


@njit(cache=True)
def moved_enough(new: Any, held: Any, threshold: Any, unknown: Any) -> Any:
    """Mask (n,) of whole numbers (n, k) that differ from `held` (n, k) by more than a layer's `threshold` (k,).

    To become known or unknown is to move; a layer without threshold (infinite) is not judged.
    """
    mask = np.zeros(new.shape[0], np.bool_)
    for i in range(new.shape[0]):
        for k in range(new.shape[1]):
            a, b = new[i, k], held[i, k]
            appeared = math.isfinite(threshold[k]) and (a == unknown[k]) != (b == unknown[k])
            mask[i] |= appeared or abs(a - b) > threshold[k]
    return mask
