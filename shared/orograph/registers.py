"""Map values as the integers that travel and are folded (protocol.md, "State"), and back."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt
from numpy.lib.recfunctions import require_fields

from orograph.arrays import I64, Mask
from orograph.grid import Grid
from orograph.layers import MAPPED, MAPPED_LAYERS, WIDTH, CellMap, Layer, holds_nothing
from orograph.messages import ROBOT_REGISTER, UPDATE, Packed
from orograph.register_kernels import put_whole_numbers

_STEP = np.array([kind.step for kind in MAPPED])
_LOWEST, _HIGHEST = np.array([kind.lowest for kind in MAPPED]), np.array([kind.highest for kind in MAPPED])
NO_CODE = np.iinfo(np.int64).min
UNKNOWN = np.array([NO_CODE if kind.unknown is None else kind.unknown for kind in MAPPED])
"""The codes of the unknown (WIDTH,), NO_CODE for a layer that has none."""


def pack(cells: npt.NDArray[Any], tick_ms: npt.ArrayLike, values: npt.ArrayLike) -> Packed:
    """UPDATE records (n,) with seq 0 from values (n, WIDTH) in the layers' units; confidence rounds to at least 1."""
    records = np.zeros(len(cells), UPDATE)
    records["cell"], records["tick"] = cells, tick_ms
    put_whole_numbers(np.asarray(values), _STEP, _LOWEST, _HIGHEST, UNKNOWN, records)
    return records


def of_robot(number: int, records: Packed) -> Packed:
    """ROBOT_REGISTERs (n,) of a robot from its UPDATEs or REGISTERs (n,), epoch 0 where they name none."""
    named: Packed = require_fields(records, ROBOT_REGISTER)
    named["robot"] = number
    return named


def has_evidence(records: Packed) -> Mask:
    """Which records (...) say anything: of the ground, of what stands on it, or that nothing does."""
    seen: Mask = (records["confidence"] > 0) | (records["confidence_top"] > 0) | (records["free_share"] > 0)
    return seen


def numbers(records: Packed) -> I64:
    """The whole numbers (..., WIDTH) of records (...) of any type with UPDATE's layers."""
    whole = np.empty((*records.shape, WIDTH), np.int64)
    for i, name in enumerate(MAPPED_LAYERS):
        whole[..., i] = records[name]
    return whole


def values(records: Packed) -> Layer:
    """Values (n, WIDTH) of records (n,) in the layers' units: what `pack` took, to within half a step."""
    whole = numbers(records)
    return np.where(whole == UNKNOWN, np.nan, whole * _STEP)


def unpack(
    records: Packed, grid: Grid, gps_quality: Layer | None = None, communications: Layer | None = None
) -> CellMap:
    """A cell map over `grid` that holds these records' values (any dtype with UPDATE's value fields), NaN elsewhere."""
    live = records[has_evidence(records)]
    cells, whole = live["cell"].astype(np.int64), values(live)
    layers = dict(CellMap.unknown(grid).by_name)
    for kind, column in zip(MAPPED, whole.T, strict=True):
        layer = np.full(grid.shape, kind.blank, np.float32)
        layer.reshape(-1)[cells] = column
        if kind.basic or not holds_nothing(kind, column):
            layers[kind.name] = layer
    if gps_quality is not None:
        layers["gps_quality"] = gps_quality.copy()
    if communications is not None:
        layers["communications"] = communications.copy()
    return CellMap(grid, layers)
