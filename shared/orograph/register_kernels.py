"""Compiled: values to the whole numbers of registers, and which of these moved enough to be worth sending.

Both loop over the layers of the table by name, so that records are written and read where they lie.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numba import literal_unroll, njit

from orograph.layers import MAPPED_LAYERS


@njit(cache=True, error_model="numpy")
def put_whole_numbers(values: Any, step: Any, lowest: Any, highest: Any, unknown: Any, records: Any) -> None:
    """Set the layers of records (n,) to the whole numbers of `step` (k,) nearest to values (n, k), within bounds.

    Halves go away from zero, NaN becomes `unknown`, and nothing stays nothing: the one rounding of the project.
    """
    for i in range(values.shape[0]):
        record, k = records[i], 0
        for name in literal_unroll(MAPPED_LAYERS):
            steps = np.float64(values[i, k]) / step[k]
            nearest = math.copysign(math.floor(abs(steps) + 0.5), steps)
            if math.isnan(steps) or steps == 0.0:
                record[name] = np.int64(0) if steps == 0.0 else unknown[k]
            else:
                record[name] = np.int64(min(max(nearest, lowest[k]), highest[k]))
            k += 1  # noqa: SIM113 - numba unrolls no enumerate


@njit(cache=True)
def says_something(record: Any) -> bool:
    """`registers.has_evidence` of one record."""
    return bool(record.confidence > 0 or record.confidence_top > 0 or record.free_share > 0)


@njit(cache=True)
def moved_enough(new: Any, held: Any, threshold: Any, unknown: Any) -> Any:
    """Mask (n,) of records `new` (n,) that say something, and what `held` (cells,) does not or more than a bit away.

    That is away by more than a layer's `threshold` (k,), or known and not `unknown` (k,) where that is to be told; a
    layer without threshold (infinite) is not judged.
    """
    mask = np.empty(new.shape[0], np.bool_)
    for i in range(new.shape[0]):
        here, there, k = new[i], held[new[i].cell], 0
        far = not says_something(there)
        for name in literal_unroll(MAPPED_LAYERS):
            a, b = np.int64(here[name]), np.int64(there[name])
            appeared = threshold[k] < math.inf and (a == unknown[k]) != (b == unknown[k])
            far |= appeared or abs(a - b) > threshold[k]
            k += 1  # noqa: SIM113 - numba unrolls no enumerate
        mask[i] = far and says_something(here)
    return mask
