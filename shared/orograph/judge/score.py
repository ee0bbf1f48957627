"""How far a map is from a truth: height errors, occupation overlap, coverage, mapping time.

Two truths, so that the error of the method and of the rule can be told apart: the true top surface, and what the same
rules give from noise-free dense scans along the patrol (`reference`).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from orograph.arrays import I64, Mask
from orograph.layers import CONFIDENT, OCCUPIED, CellMap
from orograph.storage.results import HeightErrors, MapScore

Heights = npt.NDArray[np.floating[Any]]

CONFIDENCE_BINS = ((1, 64), (64, 128), (128, 192), (192, 256))
"""Half-open [low, high); the last holds 255."""
SHARES = (50, 90, 95, 99)
NOTHING: tuple[Heights, Heights, Mask] = (np.zeros(0), np.zeros(0), np.zeros(0, np.bool_))


def height_error(errors_m: Heights) -> HeightErrors:
    """Figures of a flat array of errors [m], all finite."""
    e = errors_m.astype(np.float64)
    if not e.size:
        return HeightErrors(cells=0, rmse_m=math.nan, mae_m=math.nan, bias_m=math.nan, p95_m=math.nan)
    size = np.abs(e)
    return HeightErrors(
        cells=e.size, rmse_m=math.sqrt(float(np.mean(e * e))), mae_m=float(size.mean()), bias_m=float(e.mean()),
        p95_m=float(np.quantile(size, 0.95)),
    )  # fmt: skip


@dataclass(frozen=True, eq=False)
class Truth:
    """What a map is compared with, over that map's grid: heights [m] (NaN unknown) and which cells are occupied."""

    height_m: Heights
    occupied: Mask
    known: Mask


def truth_of_map(reference: CellMap) -> Truth:
    """A reference map as a truth: only where it is confident itself."""
    known = reference.confidence >= CONFIDENT
    return Truth(reference.height, occupied(reference), known & np.isfinite(reference.height))


def occupied(cells: CellMap) -> Mask:
    """Cells with occupation >= OCCUPIED (unknown is not occupied)."""
    return np.nan_to_num(cells.occupation, nan=0.0) >= OCCUPIED


def score_maps(pairs: list[tuple[CellMap, Truth, Mask]]) -> MapScore:
    """Pooled score of maps against truths; the mask (rows, cols) says which cells hold a building in the true scene."""
    error, confidence, building = (np.concatenate(parts) for parts in zip(NOTHING, *map(_errors, pairs), strict=True))
    sure = confidence >= CONFIDENT
    bins = tuple(height_error(error[(confidence >= low) & (confidence < high)]) for low, high in CONFIDENCE_BINS)
    both = [_overlap(cells, truth) for cells, truth, _ in pairs]
    union = sum(u for _, u in both)
    return MapScore(
        **height_error(error[sure]).model_dump(),
        by_confidence=bins,
        open_ground=height_error(error[sure & ~building]),
        buildings=height_error(error[sure & building]),
        occupation_iou=sum(i for i, _ in both) / union if union else math.nan,
    )


def _errors(pair: tuple[CellMap, Truth, Mask]) -> tuple[Heights, Heights, Mask]:
    cells, truth, building = pair
    use = cells.known & truth.known & np.isfinite(cells.height)
    return (cells.height[use] - truth.height_m[use]).astype(np.float64), cells.confidence[use], building[use]


def _overlap(cells: CellMap, truth: Truth) -> tuple[int, int]:
    use = (cells.confidence >= CONFIDENT) & truth.known
    mine, theirs = occupied(cells) & use, truth.occupied & use
    return int((mine & theirs).sum()), int((mine | theirs).sum())


def coverage(cells: CellMap, observable: Mask) -> float:
    """Share of the observable cells that are confident, NaN when none is observable."""
    total = int(observable.sum())
    return float(((cells.confidence >= CONFIDENT) & observable).sum()) / total if total else math.nan


def mapping_times_s(first_confident_ns: I64, observable: Mask) -> dict[int, float | None]:
    """Share [%] -> first simulation time [s] at which that share of the observable cells had reached confidence 64.

    `first_confident_ns` (rows * cols,) or (rows, cols), negative where never; None where the share was never reached.
    Source: mapping.md section 6, "mapping time".
    """
    reached = np.sort(first_confident_ns.reshape(-1)[observable.reshape(-1)])
    reached = reached[reached >= 0]
    total = int(observable.sum())
    needed = {share: -(-total * share // 100) for share in SHARES}
    return {s: float(reached[n - 1]) / 1e9 if 0 < n <= reached.size else None for s, n in needed.items()}
