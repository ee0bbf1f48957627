from __future__ import annotations

import json
import math
from pathlib import Path

import pytest
from made_up.run import city, made_up_summary
from orograph.launch.machine import this_machine
from orograph.messages import RunEnd
from orograph.storage.results import HeightErrors, RunInfo, Summary, WorldResult
from orograph.storage.run_folder import RUN, SUMMARY, FolderError, write_whole

KEYS = {
    "scenario", "seed", "robots", "mode", "commit", "sim_time_s", "wall_time_s", "rtf", "glrm_hash", "complete",
    "copies_hash_equal", "mapping_time_s", "stages_ms", "score", "bytes_up_per_robot_s", "bytes_down_per_robot_s",
    "cells_acked", "cells_lost", "deterministic",
}  # fmt: skip
"""What people's scripts read in summary.json."""


def test_a_summary_comes_back_and_keeps_its_keys(tmp_path: Path) -> None:
    summary = made_up_summary(2)
    summary.write(tmp_path)
    assert Summary.read(tmp_path).model_dump_json() == summary.model_dump_json()
    told = json.loads((tmp_path / SUMMARY).read_text(), parse_constant=pytest.fail)
    assert set(told) >= KEYS
    assert told["mapping_time_s"] == {"95": 300.0}
    assert told["score"]["glrm"]["ideal"]["rmse_m"] == 0.2


def test_what_is_not_known_is_null() -> None:
    nothing = HeightErrors(cells=0, rmse_m=math.nan, mae_m=math.nan, bias_m=0.5, p95_m=math.nan)
    text = nothing.model_dump_json()
    assert json.loads(text) == {"cells": 0, "rmse_m": None, "mae_m": None, "bias_m": 0.5, "p95_m": None}
    assert math.isnan(HeightErrors.model_validate_json(text).rmse_m)


def test_a_run_is_the_world_s_result_with_what_its_runner_knows(tmp_path: Path) -> None:
    ended = WorldResult.of(61_500_000_000, 7.5, RunEnd(complete=True, copies_equal=False), deterministic=True)
    assert (ended.sim_time_s, ended.complete, ended.copies_equal) == (61.5, True, False)
    assert not WorldResult.of(0, 7.5, None, deterministic=True).complete
    run = RunInfo.ran(ended, city(), "in-process", "0123", this_machine(), started_unix_s=1.0)
    run.write(tmp_path)
    assert RunInfo.read(tmp_path) == run
    assert (run.seed, run.robots, run.mode) == (1, 2, "lockstep")


def test_the_machine_is_named() -> None:
    machine = this_machine()
    assert machine.processor and machine.cores >= 1 and machine.memory_bytes > 2**28
    assert {"numpy", "numba"} <= set(machine.packages)


@pytest.mark.parametrize(("text", "words"), [(None, "is .* the folder of a run"), ("{}", "Field required"), ("{", "")])
def test_a_result_that_cannot_be_read_is_named(tmp_path: Path, text: str | None, words: str) -> None:
    if text is not None:
        write_whole(tmp_path / RUN, text)
    with pytest.raises(FolderError, match=rf"run\.json.*{words}"):
        RunInfo.read(tmp_path)
