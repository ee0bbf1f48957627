"""A run folder says when its run was begun, whoever finishes it and whatever has touched its files since."""

import os
import time
from pathlib import Path

import pytest
from orograph.launch.lifecycle import finish, prepare_out
from orograph.scenario import Scenario
from orograph.storage.results import RunInfo, WorldResult
from orograph.storage.run_folder import SCENARIO


def test_the_start_is_what_the_folder_says(
    city_scenario: Scenario, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("orograph.report.folder.compose", lambda out: None)
    before_s = time.time()
    out = prepare_out(tmp_path / "run", city_scenario)
    after_s = time.time()
    os.utime(out / SCENARIO, (1.0, 1.0))
    WorldResult.of(0, 1.0, None, deterministic=False).write(out)
    finish(city_scenario, out, "containers")
    started_s = RunInfo.read(out).started_unix_s
    assert started_s is not None and before_s <= started_s <= after_s
