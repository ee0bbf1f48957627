from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from orograph.grid import Grid
from orograph.judge.score import (
    CONFIDENCE_BINS,
    SHARES,
    Truth,
    coverage,
    height_error,
    mapping_times_s,
    score_maps,
    truth_of_map,
)  # fmt: skip
from orograph.layers import CellMap

ROW = Grid((0.0, 0.0), 1.0, (1, 4))


def row_map(height: list[float], confidence: list[float], occupation: list[float] | None = None) -> CellMap:
    cells = CellMap.unknown(ROW)
    cells.height[0], cells.confidence[0], cells.occupation[0] = height, confidence, occupation or [0.0] * 4
    return cells


def row_truth(height: list[float], occupied: list[bool], known: list[bool]) -> Truth:
    return Truth(np.array([height]), np.array([occupied]), np.array([known]))


def test_height_errors_by_hand() -> None:
    found = height_error(np.array([1.0, -1.0, 3.0, -1.0]))
    assert (found.cells, found.mae_m, found.bias_m) == (4, 1.5, 0.5)
    assert found.rmse_m == pytest.approx(math.sqrt(12 / 4))


@given(st.lists(st.floats(-50, 50), min_size=1, max_size=40))
def test_height_errors_equal_plain_python(errors: list[float]) -> None:
    found, n = height_error(np.array(errors)), len(errors)
    assert found.rmse_m == pytest.approx(math.sqrt(math.fsum(e * e for e in errors) / n), abs=1e-9)
    assert found.mae_m == pytest.approx(math.fsum(map(abs, errors)) / n, abs=1e-9)
    assert found.bias_m == pytest.approx(math.fsum(errors) / n, abs=1e-9)


def test_only_confident_and_known_cells_count() -> None:
    cells = row_map([1.0, 2.0, 3.0, 4.0], [64.0, 63.0, 255.0, 200.0])
    truth = row_truth([0.0, 0.0, 0.0, 0.0], [False] * 4, [True, True, True, False])
    score = score_maps([(cells, truth, np.array([[False, False, True, False]]))])
    assert (score.cells, score.mae_m) == (2, 2.0)
    assert (score.open_ground.cells, score.open_ground.mae_m) == (1, 1.0)
    assert (score.buildings.cells, score.buildings.mae_m) == (1, 3.0)
    assert [e.cells for e in score.by_confidence] == [1, 1, 0, 1]
    assert math.isnan(score.by_confidence[2].rmse_m)


def test_bins_hold_every_known_confidence_once() -> None:
    for confidence in range(1, 256):
        assert sum(low <= confidence < high for low, high in CONFIDENCE_BINS) == 1


def test_occupation_overlap_by_hand() -> None:
    cells = row_map([0.0] * 4, [255.0] * 4, [1.0, 0.5, 0.49, math.nan])
    truth = row_truth([0.0] * 4, [True, False, True, False], [True] * 4)
    score = score_maps([(cells, truth, np.zeros((1, 4), np.bool_))])
    assert score.occupation_iou == pytest.approx(1 / 3)


def test_several_maps_are_pooled_by_cells() -> None:
    truth, nowhere = row_truth([0.0] * 4, [False] * 4, [True] * 4), np.zeros((1, 4), np.bool_)
    pair = [(row_map([h] * 4, [255.0] * 4), truth, nowhere) for h in (1.0, 3.0)]
    score = score_maps(pair)
    assert (score.cells, score.bias_m) == (8, 2.0)


def test_nothing_to_score_gives_no_figures() -> None:
    score = score_maps([])
    assert score.cells == 0
    assert math.isnan(score.rmse_m)
    assert math.isnan(score.occupation_iou)


def test_a_reference_is_true_only_where_it_is_sure() -> None:
    truth = truth_of_map(row_map([1.0, 2.0, math.nan, 4.0], [64.0, 63.0, 255.0, 255.0], [1.0, 1.0, 0.0, 0.0]))
    assert truth.known.tolist() == [[True, False, False, True]]
    assert truth.occupied.tolist() == [[True, True, False, False]]


def test_coverage_by_hand() -> None:
    cells = row_map([0.0] * 4, [64.0, 63.0, 255.0, 255.0])
    assert coverage(cells, np.array([[True, True, True, False]])) == pytest.approx(2 / 3)
    assert math.isnan(coverage(cells, np.zeros((1, 4), np.bool_)))


def test_mapping_times_by_hand() -> None:
    first = np.arange(1, 101) * 10**9
    first[99] = -1
    times = mapping_times_s(first, np.ones(100, np.bool_))
    assert times == {50: 50.0, 90: 90.0, 95: 95.0, 99: 99.0}
    first[98] = -1
    assert mapping_times_s(first, np.ones(100, np.bool_))[99] is None


@given(st.lists(st.integers(-1, 50), min_size=1, max_size=60), st.randoms(use_true_random=False))
def test_mapping_times_equal_a_clock_run_second_by_second(first_s: list[int], random: object) -> None:
    observable = [random.random() < 0.7 for _ in first_s]  # type: ignore[attr-defined]
    first = np.array([-1 if s < 0 else s * 10**9 for s in first_s])
    expected: dict[int, float | None] = {}
    for share in SHARES:
        total = sum(observable)
        reached = (
            t for t in range(51)
            if total and 100 * sum(o and 0 <= s <= t for s, o in zip(first_s, observable, strict=True)) >= share * total
        )  # fmt: skip
        expected[share] = next((float(t) for t in reached), None)
    assert mapping_times_s(first, np.array(observable)) == expected
