from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from orograph import keys
from orograph.grid import Grid
from orograph.judge.improvement import BeforeAfter, improvement, prior_over
from orograph.judge.map_truth import MapTruth
from orograph.judge.reference import Reference
from orograph.judge.summary import judge
from orograph.layers import CellMap
from orograph.storage.parts import RunParts
from orograph.storage.results import Improvement

ROW = Grid((0.0, 0.0), 5.0, (1, 4))
OPEN, WALL = np.array([[False] * 4]), np.array([[False, False, False, True]])


def cells(height: list[float], confidence: list[float], occupation: list[float]) -> CellMap:
    out = CellMap.unknown(ROW)
    out.height[0], out.confidence[0], out.occupation[0] = height, confidence, occupation
    return out


def before_after() -> BeforeAfter:
    """Three open cells at 0 m, the third beside the fourth, on which stands a house of 6 m; the prior says 10."""
    truth = MapTruth(
        ROW, ground_m=np.zeros((1, 4)), top_m=np.array([[np.nan, np.nan, np.nan, 6.0]]), surface_m=np.zeros((1, 4)),
        roof=WALL, steep=OPEN, near=np.array([[False, False, True, False]]),
    )  # fmt: skip
    prior = cells([0.2, 0.0, 0.0, 10.0], [32.0] * 4, [0.0, 0.0, 0.0, 1.0])
    final = cells([0.1, 0.0, 1.0, 7.0], [200.0, 32.0, 64.0, 63.0], [0.0, 0.0, 1.0, 1.0])
    return BeforeAfter.of(prior, final, truth)


def test_both_maps_are_judged_on_the_same_cells_by_hand() -> None:
    found = improvement([before_after()])
    sure, touched = found.confident, found.touched
    assert (sure.final.ground_away_cells, sure.final.ground_near_cells, sure.final.object_cells) == (1, 1, 0)
    assert (sure.prior.ground_away_rmse_m, sure.final.ground_away_rmse_m) == pytest.approx((0.2, 0.1))
    assert (sure.prior.ground_near_rmse_m, sure.final.ground_near_rmse_m) == (0.0, 1.0)
    # The second cell is as the prior had it.
    assert (touched.final.ground_away_cells, touched.final.object_cells) == (1, 1)
    assert (touched.prior.object_mae_m, touched.final.object_mae_m) == (4.0, 1.0)
    assert (touched.prior.precision, touched.final.precision) == (1.0, 0.5)
    assert (touched.final.recall, touched.final.iou, touched.final.houses_drivable) == (1.0, 0.5, 0.0)


def test_maps_of_a_kind_are_pooled_and_none_is_none() -> None:
    one, two = improvement([before_after()]), improvement([before_after()] * 2)
    assert two.touched.final.object_cells == 2 * one.touched.final.object_cells
    assert two.touched.final.object_mae_m == one.touched.final.object_mae_m
    assert Improvement.model_validate_json(improvement([]).model_dump_json()).touched.final.object_cells == 0


def test_the_prior_is_cut_into_a_local_map_s_cells_and_unknown_beyond_its_edge() -> None:
    prior = cells([1.0, 2.0, 3.0, 4.0], [32.0] * 4, [0.0] * 4)
    under = prior_over(prior, Grid((15.0, -5.0), 2.5, (4, 4)))
    assert under.height[2:, :2].tolist() == [[4.0, 4.0], [4.0, 4.0]]
    assert np.isnan(under.height[:2]).all() and np.isnan(under.height[:, 2:]).all()


def test_a_map_made_worse_scores_worse(city_run: RunParts, built: Reference) -> None:
    """The whole judgement of a made-up run: ten metres more in every cell of the map are seen, and in the map alone."""
    good = judge(city_run, built).summary.improvement.glrm.touched
    manager = city_run.nodes[keys.MANAGER]
    glrm = manager["glrm"].copy()
    glrm["height"] += 10_000
    bad = replace(city_run, nodes={**city_run.nodes, keys.MANAGER: {**manager, "glrm": glrm}})
    worse = judge(bad, built).summary.improvement.glrm.touched
    assert worse.prior == good.prior
    assert worse.final.ground_away_rmse_m == pytest.approx(10.0, abs=0.3)
    assert good.final.ground_away_rmse_m < 0.3
