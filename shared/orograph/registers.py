"""Map values as the integers that travel and are folded (protocol.md, "Register"), and back."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from orograph.grid import Grid
from orograph.layers import CellMap, Layer
from orograph.messages import OCCUPATION_ONE, RECORD, UNKNOWN_GRADIENT, UNKNOWN_OCCUPATION, Packed

GRADIENT_UNIT = 1e-4
HEIGHT_UNIT_M = 1e-3


def round_half_away(values: npt.ArrayLike) -> npt.NDArray[np.float64]:
    """Nearest whole number, halves away from zero: the one rounding of the project."""
    v = np.asarray(values, np.float64)
    return np.copysign(np.floor(np.abs(v) + 0.5), v)


def _gradient(values: npt.NDArray[Any]) -> npt.NDArray[np.int16]:
    whole = round_half_away(np.nan_to_num(values, nan=0.0) / GRADIENT_UNIT)
    whole = np.clip(whole, -32767, 32767)
    return np.where(np.isnan(values), UNKNOWN_GRADIENT, whole).astype(np.int16)


def pack(
    cells: npt.NDArray[Any], tick_ms: npt.ArrayLike, height: Layer, gradient_x: Layer, gradient_y: Layer,
    occupation: Layer, confidence: Layer,
) -> Packed:  # fmt: skip
    """Records (n,) with seq 0 from values (n,) in SI units; confidence rounds to at least 1."""
    records = np.zeros(len(cells), RECORD)
    records["cell"] = cells
    records["tick"] = tick_ms
    records["height"] = round_half_away(np.asarray(height, np.float64) / HEIGHT_UNIT_M)
    records["gradient_x"], records["gradient_y"] = _gradient(gradient_x), _gradient(gradient_y)
    whole = round_half_away(np.nan_to_num(occupation, nan=0.0) * OCCUPATION_ONE)
    records["occupation"] = np.where(np.isnan(occupation), UNKNOWN_OCCUPATION, np.clip(whole, 0, OCCUPATION_ONE))
    records["confidence"] = np.clip(round_half_away(confidence), 1, 255)
    return records


def unpack(
    records: Packed, grid: Grid, gps_quality: Layer | None = None, communications: Layer | None = None
) -> CellMap:
    """A cell map over `grid` that holds these records' values (any dtype with RECORD's value fields), NaN elsewhere."""
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
