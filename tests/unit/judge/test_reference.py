from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from orograph.judge import reference
from orograph.judge.reference import Reference
from orograph.layers import CONFIDENT, MAPPED_LAYERS
from orograph.scenario import Scenario
from orograph.scene import build_scene
from orograph.sensing.truth import top_surface


@pytest.fixture(scope="module")
def built(city_scenario: Scenario) -> Reference:
    return reference.build(city_scenario)


def same(a: Reference, b: Reference) -> bool:
    return a.glrm.equals(b.glrm) and a.hrm.equals(b.hrm) and np.array_equal(a.poses, b.poses)


def test_it_comes_back_from_the_cache_unchanged_and_is_not_made_twice(
    city_scenario: Scenario, built: Reference, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(reference, "build", lambda scenario: built)
    assert same(reference.cached(city_scenario, tmp_path / "new"), built)
    monkeypatch.setattr(reference, "build", lambda scenario: pytest.fail("made twice"))
    assert same(reference.cached(city_scenario, tmp_path / "new"), built)


def test_another_scenario_or_version_is_made_anew(
    city_scenario: Scenario, built: Reference, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    made: list[Scenario] = []

    def build(scenario: Scenario) -> Reference:
        made.append(scenario)
        return built

    monkeypatch.setattr(reference, "build", build)
    reference.cached(city_scenario, tmp_path)
    reference.cached(city_scenario.model_copy(update={"base_station_m": (1.0, 1.0)}), tmp_path)
    monkeypatch.setattr(reference, "VERSION", "another")
    reference.cached(city_scenario, tmp_path)
    assert len(made) == 3


def test_a_cache_that_cannot_be_written_costs_only_time(
    city_scenario: Scenario, built: Reference, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(reference, "build", lambda scenario: built)
    (tmp_path / "file").write_text("where the cache should be")
    assert same(reference.cached(city_scenario, tmp_path / "file"), built)


def test_ideal_scans_on_open_ground_give_the_true_surface(city_scenario: Scenario, built: Reference) -> None:
    scene, hrm = build_scene(city_scenario), built.hrm
    height, occupied = top_surface(scene, hrm.grid, 3)
    ground = scene.height_m(*np.meshgrid(*hrm.grid.centres_m()))
    # Away from walls, where a cell of 0.5 m holds nothing but gently sloping ground.
    flat = (hrm.confidence >= CONFIDENT) & ~occupied & (np.abs(height - ground) < 0.1)
    assert flat.sum() > 500
    error = (hrm.height - height)[flat]
    assert np.abs(np.median(error)) < 0.02
    assert np.quantile(np.abs(error), 0.9) < 0.05


def test_the_observable_cells_lie_along_the_patrol(city_scenario: Scenario, built: Reference) -> None:
    rows, cols = np.nonzero(built.observable)
    assert rows.size > 40
    x, y = city_scenario.grid.grid.centres_m()
    away = np.hypot(x[cols][:, None] - built.poses[:, 0], y[rows][:, None] - built.poses[:, 1]).min(axis=1)
    assert away.max() < city_scenario.laser.range_max_m


def test_a_window_of_the_reference_is_cut_at_the_right_place(built: Reference) -> None:
    whole = built.hrm
    window = whole.grid.window(-3, 7, (20, 30))
    cut = built.hrm_over(window)
    assert not cut.known[:3].any()
    for name in MAPPED_LAYERS:
        np.testing.assert_array_equal(getattr(cut, name)[3:], getattr(whole, name)[:17, 7:37])
    assert not built.hrm_over(whole.grid.window(5_000, 0, (4, 4))).known.any()
