"""Whole missions on `tiny`: one process, processes over Zenoh, any number of workers, killed parts: one map."""

from pathlib import Path

import pytest
from orograph.launch.lifecycle import resolve, run
from orograph.storage.results import Summary
from orograph.storage.scenario_file import load_scenario

pytestmark = pytest.mark.cluster
TINY = load_scenario("scenarios/tiny")


def test_a_mission_ends_with_one_map_and_nothing_lost(in_process: Summary) -> None:
    assert in_process.complete and in_process.copies_hash_equal and in_process.cells_lost == 0
    assert in_process.cells_acked > 100 and in_process.glrm_is_own_fold
    assert in_process.coverage > 0.9


def test_the_same_seed_gives_the_same_map_again_and_another_seed_does_not(in_process: Summary, tmp_path: Path) -> None:
    again = Summary.read(run(TINY, tmp_path / "again", in_process=True))
    assert again.glrm_hash == in_process.glrm_hash
    other = Summary.read(run(resolve(TINY, None, TINY.seed + 1, None), tmp_path / "other", in_process=True))
    assert other.glrm_hash != in_process.glrm_hash


@pytest.mark.parametrize("capacity", [1, 3])
def test_processes_over_zenoh_give_the_same_map(in_process: Summary, tmp_path: Path, capacity: int) -> None:
    summary = Summary.read(run(TINY, tmp_path / "run", capacity=capacity))
    assert summary.deterministic and summary.complete
    assert summary.glrm_hash == in_process.glrm_hash
    assert summary.copies_hash_equal and summary.cells_lost == 0
