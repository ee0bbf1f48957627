"""Recorded scans mapped again give the mission's own map, and other scans another."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from bench.map_recording import Mission, record, recorded
from bench.map_replay import Replay, believed
from bench.map_score import Judge, Pool, with_prior
from bench.map_street import Course, run_course, views, worst
from orograph.scenario import Scenario
from orograph.storage.scenario_file import load_scenario

SECONDS = 6.0


@pytest.fixture(scope="module")
def short() -> tuple[Scenario, Mission]:
    """Six seconds of `tiny` by the rules that it names."""
    tiny = load_scenario("scenarios/tiny")
    scenario = Scenario.model_validate({**tiny.model_dump(), "duration_max_s": SECONDS})
    heard: list[float] = []
    mission = record(scenario, heard.append)
    assert heard == sorted(heard) and heard[-1] >= SECONDS
    return scenario, mission


def replayed(scenario: Scenario, mission: Mission, rules: str) -> Replay:
    replay = Replay(scenario, rules)
    for scan, ranges in zip(mission.scans, mission.ranges, strict=True):
        replay.map(int(scan["robot"]), ranges, *believed(scan, scenario.laser), int(scan["stamp_ns"]))
    return replay


def test_offline_the_map_is_the_missions(short):
    scenario, mission = short
    assert isinstance(scenario.rules, str)
    assert replayed(scenario, mission, scenario.rules).glrm_hash() == mission.glrm_hash
    assert replayed(scenario, mission, "paper").glrm_hash() != mission.glrm_hash
    fewer = replace(mission, scans=mission.scans[:-1], ranges=mission.ranges[:-1])
    assert replayed(scenario, fewer, scenario.rules).glrm_hash() != mission.glrm_hash


def test_a_recording_is_kept_and_comes_back_whole(short, tmp_path, monkeypatch):
    scenario, mission = short
    monkeypatch.setattr("bench.map_recording.record", lambda scenario, progress: mission)
    recorded(scenario, tmp_path, print)
    monkeypatch.delattr("bench.map_recording.record")
    again = recorded(scenario, tmp_path, print)
    for name in ("scans", "ranges", "bodies", "glrm_hash", "commit"):
        np.testing.assert_array_equal(getattr(again, name), getattr(mission, name))


@pytest.mark.parametrize("prior", ["exact", "honest", "none"])
def test_all_figures_are_there_with_every_prior(short, prior):
    scenario, mission = short
    told, pool = with_prior(scenario, prior), Pool()
    judge, replay = Judge(told), Replay(told, "surface")
    judge.scans(mission, replay, pool, lambda: None)
    judge.maps(replay, pool)
    figures = pool.figures()
    assert figures["glrm confident"]["ground_away_cells"] > 10
    assert figures["glrm confident"]["ground_away_rmse_m"] < 0.15 < figures["hrm touched"]["object_mae_m"]
    assert len(pool.ghosts) == len(mission.scans)


def test_a_house_that_is_built_before_a_standing_robot_is_found(monkeypatch):
    for name, seconds in (("BEGIN_S", 0.8), ("PRESENT_S", 1.2), ("AFTER_S", 0.8)):
        monkeypatch.setattr(f"bench.map_street.{name}", seconds)
    course = Course("house", "standing")
    times = run_course(list(views(course, seed=1)), course, "paper", lambda: None)
    assert times["found_s"] == pytest.approx(0.0, abs=0.41)
    assert times["cleared_s"] is None  # it still shows what has gone


def test_of_several_runs_the_worst_counts():
    runs = [{"a": 1.0, "b": 1.0, "c": math.nan}, {"a": 3.0, "b": None, "c": math.nan}, {"a": 2.0, "b": 9.0, "c": 0.4}]
    assert worst(runs) == {"a": 3.0, "b": None, "c": 0.4}
    assert math.isnan(worst(runs[:2])["c"] or 0.0)
