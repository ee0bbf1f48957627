"""Map values as the integers that travel and are folded (protocol.md, "State"), and back."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from orograph.arrays import F64
from orograph.grid import Grid
from orograph.layers import CellMap, Layer
from orograph.messages import OCCUPATION_ONE, UNKNOWN_GRADIENT, UNKNOWN_OCCUPATION, UPDATE, Packed

GRADIENT_UNIT = 1e-4
HEIGHT_UNIT_M = 1e-3


def round_half_away(values: npt.ArrayLike) -> F64:
    """Nearest whole number, halves away from zero: the one rounding of the project."""
    v = np.asarray(values, np.float64)
    return np.copysign(np.floor(np.abs(v) + 0.5), v)


_PER_UNIT = np.array([[HEIGHT_UNIT_M], [GRADIENT_UNIT], [GRADIENT_UNIT], [1.0], [1.0]])
_LOWEST = np.array([[-(2.0**31)], [-32767], [-32767], [0], [1]])
_HIGHEST = np.array([[2.0**31 - 1], [32767], [32767], [OCCUPATION_ONE], [255]])
_UNKNOWN = np.array([[0], [UNKNOWN_GRADIENT], [UNKNOWN_GRADIENT], [UNKNOWN_OCCUPATION], [0]])
"""Rows as in `pack`: height, gradients, occupation, confidence; in few passes, for a scan packs hundreds."""


def pack(
    cells: npt.NDArray[Any], tick_ms: npt.ArrayLike, height: Layer, gradient_x: Layer, gradient_y: Layer,
    occupation: Layer, confidence: Layer,
) -> Packed:  # fmt: skip
    """Records (n,) with seq 0 from values (n,) in SI units; confidence rounds to at least 1."""
    records = np.zeros(len(cells), UPDATE)
    records["cell"] = cells
    records["tick"] = tick_ms
    values = np.array([height, gradient_x, gradient_y, occupation, confidence], np.float64)
    values[3] *= OCCUPATION_ONE
    whole = np.clip(round_half_away(values / _PER_UNIT), _LOWEST, _HIGHEST)
    whole = np.where(np.isnan(values), _UNKNOWN, whole)
    for name, row in zip(("height", "gradient_x", "gradient_y", "occupation", "confidence"), whole, strict=True):
        records[name] = row
    return records


def unpack(
    records: Packed, grid: Grid, gps_quality: Layer | None = None, communications: Layer | None = None
) -> CellMap:
    """A cell map over `grid` that holds these records' values (any dtype with UPDATE's value fields), NaN elsewhere."""
    out = CellMap.unknown(grid)
    if gps_quality is not None:
        out.gps_quality[...] = gps_quality
    if communications is not None:
        out.communications[...] = communications
    live = records[records["confidence"] > 0]
    cells = live["cell"].astype(np.int64)
    out.height.reshape(-1)[cells] = live["height"] * HEIGHT_UNIT_M
    for name in ("gradient_x", "gradient_y"):
        values = np.where(live[name] == UNKNOWN_GRADIENT, np.nan, live[name] * GRADIENT_UNIT)
        getattr(out, name).reshape(-1)[cells] = values
    occupation = np.where(live["occupation"] == UNKNOWN_OCCUPATION, np.nan, live["occupation"] / OCCUPATION_ONE)
    out.occupation.reshape(-1)[cells] = occupation
    out.confidence.reshape(-1)[cells] = live["confidence"]
    return out
