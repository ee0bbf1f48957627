"""A map against the truth, cell by cell: ground, tops of objects, occupation, and whether confidence tells the error.

Cells of many maps are pooled as records; every figure is a plain function of such records.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import numpy.typing as npt

from orograph.arrays import F64, Mask
from orograph.judge.map_truth import MapTruth
from orograph.judge.score import CONFIDENCE_BINS, height_error
from orograph.layers import CONFIDENT, OCCUPIED, CellMap
from orograph.storage.results import HeightErrors

JUDGED = np.dtype(
    [
        ("roof", "?"),  # built up in truth
        ("near", "?"),  # open and beside a wall
        ("barred", "?"),  # cannot be driven in truth
        ("error_m", "<f4"),  # of the top on roofs, of the ground elsewhere; NaN where the map knows no height
        ("confidence", "<f4"),  # of that height
        ("occupied", "?"),  # the map says so
    ]
)
SURE = 128.0
WRONG_M = 0.5
"""A height that is further off than this is wrong, for what confidence promises."""

Judged = npt.NDArray[Any]


def top_m(cells: CellMap) -> F64:
    """The upper surface (rows, cols) [m], whether it bars a cell or not."""
    return np.asarray(cells.tops, np.float64)


def confidence_of(cells: CellMap, truth: MapTruth) -> F64:
    """Confidence (rows, cols) in what is judged: `confidence_top` on roofs whose top is known, else `confidence`."""
    own = getattr(cells, "confidence_top", cells.confidence)
    return np.where(truth.roof & np.isfinite(_top(cells)), own, cells.confidence).astype(np.float64)


def _top(cells: CellMap) -> F64:
    return np.asarray(getattr(cells, "height_top", np.full(cells.height.shape, np.nan)), np.float64)


def confident(cells: CellMap, truth: MapTruth) -> Mask:
    """Cells (rows, cols) that the map claims to know."""
    return confidence_of(cells, truth) >= CONFIDENT


def judged(cells: CellMap, truth: MapTruth, where: Mask) -> Judged:
    """JUDGED (n,) of the cells of a map in the mask `where` (rows, cols) for which there is a truth, row by row."""
    use = where & np.isfinite(truth.ground_m)
    out = np.zeros(int(use.sum()), JUDGED)
    error_m = np.where(truth.roof, top_m(cells) - truth.top_m, cells.height - truth.ground_m)
    occupied = np.nan_to_num(cells.occupation, nan=0.0) >= OCCUPIED
    layers = (truth.roof, truth.near, truth.barred, error_m, confidence_of(cells, truth), occupied)
    for name, layer in zip(JUDGED.names or (), layers, strict=True):
        out[name] = layer[use]
    return out


def map_figures(cells: Judged) -> dict[str, float]:
    """Figures of JUDGED records (n,); lengths in metres, shares of 1, NaN where there is nothing to judge.

    Unknown heights count in `unknown` alone; unknown occupation is not occupied.
    """
    roof, said, true = cells["roof"], cells["occupied"], cells["barred"]
    near, away, objects = (_errors(cells, m) for m in (cells["near"], ~roof & ~cells["near"], roof))
    both, either = int((said & true).sum()), int((said | true).sum())
    return {
        "ground_near_rmse_m": near.rmse_m, "ground_near_cells": near.cells,
        "ground_away_rmse_m": away.rmse_m, "ground_away_cells": away.cells,
        "object_mae_m": objects.mae_m, "object_rmse_m": objects.rmse_m, "object_bias_m": objects.bias_m,
        "object_cells": objects.cells,
        "unknown": share(int(np.isnan(cells["error_m"]).sum()), len(cells)),
        "precision": share(both, int(said.sum())), "recall": share(both, int(true.sum())),
        "iou": share(both, either), "houses_drivable": share(int((roof & ~said).sum()), int(roof.sum())),
    }  # fmt: skip


def wrong_though_sure(cells: Judged) -> float:
    """Share of the known heights of JUDGED records (n,) with confidence >= SURE that are off by more than WRONG_M."""
    errors = cells["error_m"][(cells["confidence"] >= SURE) & np.isfinite(cells["error_m"])]
    return share(int((np.abs(errors) > WRONG_M).sum()), len(errors))


def calibration(cells: Judged) -> list[dict[str, float]]:
    """Per bin of confidence: error and share of wrong heights of open cells away from walls, near walls, and roofs."""
    out: list[dict[str, float]] = []
    for low, high in CONFIDENCE_BINS:
        within = (cells["confidence"] >= low) & (cells["confidence"] < high)
        row: dict[str, float] = {"low": low, "high": high - 1}
        kinds = {"away": ~cells["roof"] & ~cells["near"], "near": cells["near"], "roof": cells["roof"]}
        for name, kind in kinds.items():
            errors = cells["error_m"][within & kind & np.isfinite(cells["error_m"])]
            row[f"{name}_rmse_m"] = height_error(errors).rmse_m
            row[f"{name}_wrong"] = share(int((np.abs(errors) > WRONG_M).sum()), len(errors))
            row[f"{name}_cells"] = len(errors)
        out.append(row)
    return out


def share(part: int, whole: int) -> float:
    """part / whole, NaN of nothing."""
    return part / whole if whole else math.nan


def _errors(cells: Judged, mask: Mask) -> HeightErrors:
    errors = cells["error_m"][mask]
    return height_error(errors[np.isfinite(errors)])
