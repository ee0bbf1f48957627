"""The scorer against plain Python on hand-made maps, and that each column gets worse with a worse map."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from orograph.grid import Grid
from orograph.judge.map_score import calibration, confident, judged, map_figures, top_m, wrong_though_sure
from orograph.judge.map_truth import MapTruth
from orograph.layers import CellMap

GRID = Grid((0.0, 0.0), 5.0, (6, 6))
EVERYWHERE = np.ones(GRID.shape, np.bool_)


def truth(steep: tuple[int, int] = (5, 5)) -> MapTruth:
    """A house of four cells, 8 m over ground that rises by 1 m a row; the ring round it is near; one cell is steep."""
    ground_m = np.repeat(np.arange(6.0)[:, None], 6, axis=1)
    roof, near, hard = (np.zeros(GRID.shape, np.bool_) for _ in range(3))
    roof[2:4, 2:4] = True
    near[1:5, 1:5] = True
    hard[steep] = True
    top_m, surface_m = (np.where(roof, ground_m + 8.0, below) for below in (np.nan, ground_m))
    return MapTruth(GRID, ground_m, top_m, surface_m, roof, hard, near & ~roof)


def perfect() -> CellMap:
    """All of the truth, and sure of it."""
    cells, true = CellMap.unknown(GRID), truth()
    cells.height[...] = np.where(true.roof, true.top_m, true.ground_m)
    cells.occupation[...] = true.barred
    cells.confidence[...] = 200.0
    return cells


def plain_figures(cells: CellMap, true: MapTruth, where: np.ndarray) -> dict[str, float]:
    """The figures cell by cell, without arrays."""
    errors: dict[str, list[float]] = {"near": [], "away": [], "roof": []}
    count = dict.fromkeys(("unknown", "all", "both", "said", "true", "roofs", "drivable"), 0)
    for row in range(GRID.rows):
        for col in range(GRID.cols):
            if not where[row, col]:
                continue
            kind = "roof" if true.roof[row, col] else "near" if true.near[row, col] else "away"
            wanted = true.top_m[row, col] if kind == "roof" else true.ground_m[row, col]
            height = float(cells.height[row, col])
            count["all"] += 1
            if math.isnan(height):
                count["unknown"] += 1
            else:
                errors[kind].append(height - wanted)
            said = bool(cells.occupation[row, col] >= 0.5)  # False for NaN
            barred = bool(true.roof[row, col] or true.steep[row, col])
            count["said"] += said
            count["true"] += barred
            count["both"] += said and barred
            count["roofs"] += kind == "roof"
            count["drivable"] += kind == "roof" and not said

    def part(a: int, b: int) -> float:
        return a / b if b else math.nan

    def mean(values: list[float]) -> float:
        return sum(values) / len(values) if values else math.nan

    roof = errors["roof"]
    return {
        "ground_near_rmse_m": math.sqrt(mean([e * e for e in errors["near"]])),
        "ground_near_cells": len(errors["near"]),
        "ground_away_rmse_m": math.sqrt(mean([e * e for e in errors["away"]])),
        "ground_away_cells": len(errors["away"]),
        "object_mae_m": mean([abs(e) for e in roof]),
        "object_rmse_m": math.sqrt(mean([e * e for e in roof])),
        "object_bias_m": mean(roof),
        "object_cells": len(roof),
        "unknown": part(count["unknown"], count["all"]),
        "precision": part(count["both"], count["said"]),
        "recall": part(count["both"], count["true"]),
        "iou": part(count["both"], count["said"] + count["true"] - count["both"]),
        "houses_drivable": part(count["drivable"], count["roofs"]),
    }


@given(st.integers(0, 2**32 - 1))
def test_figures_are_those_of_plain_python(seed: int):
    drawn = np.random.default_rng(seed)
    cells = perfect()
    cells.height[...] += drawn.normal(0, 2, GRID.shape)
    cells.height[drawn.random(GRID.shape) < 0.2] = np.nan
    cells.occupation[...] = drawn.choice([0.0, 0.49, 0.5, 1.0, np.nan], GRID.shape)
    where = drawn.random(GRID.shape) < 0.7
    found = map_figures(judged(cells, truth(), where))
    wanted = plain_figures(cells, truth(), where)
    assert found.keys() == wanted.keys()
    for name, value in wanted.items():
        assert found[name] == pytest.approx(value, rel=1e-5, abs=1e-6, nan_ok=True), (name, seed)


def test_a_perfect_map():
    figures = map_figures(judged(perfect(), truth(), EVERYWHERE))
    assert [figures[k] for k in ("ground_near_rmse_m", "ground_away_rmse_m", "object_mae_m", "unknown")] == [0.0] * 4
    assert [figures[k] for k in ("precision", "recall", "iou", "houses_drivable")] == [1.0, 1.0, 1.0, 0.0]
    assert wrong_though_sure(judged(perfect(), truth(), EVERYWHERE)) == 0.0


def lift(name: str, cells: CellMap) -> None:
    cells.height[{"near": truth().near, "away": ~truth().near & ~truth().roof, "roof": truth().roof}[name]] += 1.0


def say(value: float, where: tuple[int, int]) -> Callable[[CellMap], None]:
    def worsen(cells: CellMap) -> None:
        cells.occupation[where] = value

    return worsen


def forget(cells: CellMap) -> None:
    cells.height[0, 0] = np.nan


@pytest.mark.parametrize(
    ("column", "sign", "worsen"),
    [
        ("ground_near_rmse_m", 1, lambda cells: lift("near", cells)),
        ("ground_away_rmse_m", 1, lambda cells: lift("away", cells)),
        ("object_mae_m", 1, lambda cells: lift("roof", cells)),
        ("object_rmse_m", 1, lambda cells: lift("roof", cells)),
        ("object_bias_m", 1, lambda cells: lift("roof", cells)),
        ("unknown", 1, forget),
        ("precision", -1, say(1.0, (0, 0))),
        ("recall", -1, say(0.0, (5, 5))),
        ("iou", -1, say(0.0, (2, 2))),
        ("houses_drivable", 1, say(0.4, (2, 2))),
    ],
)
def test_a_worse_map_scores_worse_in_each_column(column: str, sign: int, worsen: Callable[[CellMap], None]):
    worse = perfect()
    worsen(worse)
    good, bad = (map_figures(judged(cells, truth(), EVERYWHERE))[column] for cells in (perfect(), worse))
    assert sign * (bad - good) > 0.02, (column, good, bad)


def test_sure_and_wrong_is_told_by_bin_and_kind():
    cells = perfect()
    cells.height[0, 0] += 0.51
    cells.height[0, 1] += 0.49
    cells.height[1, 1] -= 3.0
    cells.confidence[2, 2], cells.height[2, 2] = 100.0, 0.0
    records = judged(cells, truth(), EVERYWHERE)
    assert wrong_though_sure(records) == pytest.approx(2 / 35)
    bins = calibration(records)
    assert [(b["low"], b["high"]) for b in bins] == [(1, 63), (64, 127), (128, 191), (192, 255)]
    assert (bins[1]["roof_cells"], bins[1]["roof_wrong"], bins[1]["roof_rmse_m"]) == (1, 1.0, 10.0)
    assert bins[3]["away_wrong"] == pytest.approx(1 / 20) and bins[3]["near_wrong"] == pytest.approx(1 / 12)
    assert bins[3]["roof_cells"] == 3 and bins[3]["roof_wrong"] == 0.0 and math.isnan(bins[0]["away_wrong"])


def test_of_two_layers_the_top_counts_on_roofs_with_its_own_confidence():
    true, flat = truth(), perfect()
    top = np.where(true.roof, true.top_m, np.nan).astype(np.float32)
    top[2, 2] = np.nan  # not known there: what is known is the ground
    layers = {"height": true.ground_m.astype(np.float32), "height_top": top,
              "confidence_top": np.where(true.roof, 70.0, 0.0).astype(np.float32)}  # fmt: skip
    cells = CellMap(flat.grid, {**flat.by_name, **layers})
    assert top_m(cells)[2, 2] == true.ground_m[2, 2] and top_m(cells)[3, 3] == true.top_m[3, 3]
    records = judged(cells, true, EVERYWHERE)
    assert sorted(records["error_m"][records["roof"]].tolist()) == [-8.0, 0.0, 0.0, 0.0]
    # Where no top is known the map holds that its ground is all there is, and that confidence counts.
    assert sorted(records["confidence"][records["roof"]].tolist()) == [70.0, 70.0, 70.0, 200.0]
    cells.confidence_top[3, 3] = 10.0
    assert not confident(cells, true)[3, 3] and confident(cells, true).sum() == 35


def test_from_above_a_top_is_seen_where_it_bars() -> None:
    cells = CellMap.unknown(Grid((0.0, 0.0), 5.0, (1, 3)))
    cells.height[:], cells.occupation[:] = 2.0, [[0.1, 1.0, np.nan]]
    assert cells.visible.tolist() == [[2.0, 2.0, 2.0]]
    tops = CellMap(cells.grid, {**cells.by_name, "height_top": np.array([[9.0, 8.0, 7.0]], np.float32)})
    assert tops.visible.tolist() == [[2.0, 8.0, 2.0]]
