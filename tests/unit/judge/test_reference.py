from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from orograph.judge import reference
from orograph.judge.reference import Reference
from orograph.layers import BASIC_LAYERS, CONFIDENT
from orograph.scenario import PriorSpec, RadioSpec, Scenario
from orograph.scene import build_scene
from orograph.sensing.truth import top_surface


def same(a: Reference, b: Reference) -> bool:
    return a.glrm.equals(b.glrm) and a.hrm.equals(b.hrm) and np.array_equal(a.poses, b.poses)


def test_it_comes_back_from_the_cache_unchanged_and_is_not_made_twice(
    city_scenario: Scenario, built: Reference, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(reference, "build", lambda scenario: built)
    assert same(reference.cached(city_scenario, tmp_path / "new"), built)
    monkeypatch.setattr(reference, "build", lambda scenario: pytest.fail("made twice"))
    assert same(reference.cached(city_scenario, tmp_path / "new"), built)


@pytest.fixture
def made(built: Reference, monkeypatch: pytest.MonkeyPatch) -> list[Scenario]:
    """What is built from now on, quickly."""
    scenarios: list[Scenario] = []

    def build(scenario: Scenario) -> Reference:
        scenarios.append(scenario)
        return built

    monkeypatch.setattr(reference, "build", build)
    return scenarios


@pytest.mark.parametrize(
    ("change", "times"),
    [({"seed": 77}, 1), ({"title": "Another", "radio": RadioSpec(loss=0.2)}, 1), ({"robots": 1}, 2),
     ({"prior": PriorSpec(confidence=0)}, 1), ({"prior": PriorSpec(ground_error_m=0.4, missing=0.5)}, 1),
     ({"rules": "paper"}, 2), ({"patrol": ((60.0, 10.0), (110.0, 110.0))}, 2)],
)  # fmt: skip
def test_only_what_moves_the_reference_makes_it_anew(
    change: dict[str, object], times: int, city_scenario: Scenario, made: list[Scenario], tmp_path: Path
) -> None:
    reference.cached(city_scenario, tmp_path)
    reference.cached(city_scenario.model_copy(update=change), tmp_path)
    assert len(made) == times


def test_what_it_does_not_depend_on_cannot_move_it(city_scenario: Scenario, built: Reference, tmp_path: Path) -> None:
    another = city_scenario.model_copy(update={"seed": 77, "base_station_m": (90.0, 90.0), "frame_ms": 50})
    assert same(reference.cached(another, tmp_path), built)


def test_other_code_makes_it_anew(
    city_scenario: Scenario, made: list[Scenario], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    reference.cached(city_scenario, tmp_path)
    monkeypatch.setattr(reference, "code_digest", lambda module: "other")
    reference.cached(city_scenario, tmp_path)
    assert len(made) == 2


def test_the_oldest_are_thrown_away(
    city_scenario: Scenario, made: list[Scenario], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(reference, "KEPT_MAX", 2)
    for robots in (1, 2):
        for rules in ("paper", "surface"):
            reference.cached(city_scenario.model_copy(update={"robots": robots, "rules": rules}), tmp_path)
    assert len(made) == 4 and len(list(tmp_path.iterdir())) == 2


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
    for name in BASIC_LAYERS:
        np.testing.assert_array_equal(getattr(cut, name)[3:], getattr(whole, name)[:17, 7:37])
    assert not built.hrm_over(whole.grid.window(5_000, 0, (4, 4))).known.any()
