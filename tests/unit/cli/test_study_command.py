from __future__ import annotations

import argparse
import json
from pathlib import Path
from typing import Any

import pytest
from made_up.run import made_up_summary
from orograph.cli import study
from orograph.errors import InputError
from orograph.scenario import Scenario
from orograph.storage.run_folder import STUDY, STUDY_PAGE


@pytest.fixture
def scenario() -> Scenario:
    starts = [{"x_m": 10.0 + 5 * i, "y_m": 10.0} for i in range(3)]
    return Scenario.model_validate(
        {
            "name": "field", "title": "A field", "starts": starts, "base_station_m": [5.0, 5.0],
            "patrol": [[50.0, 50.0]],
        }
    )  # fmt: skip


def fake_run(scenario: Scenario, out: Path, **_: Any) -> Path:
    out.mkdir()
    made_up_summary(scenario.robots).write(out)
    return out


def arguments(*argv: str) -> argparse.Namespace:
    top = argparse.ArgumentParser()
    study.add_parser(top.add_subparsers())
    return top.parse_args(["study", *argv])


def test_each_number_is_run_once_and_told_beside_the_paper(
    scenario: Scenario, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(study, "load_scenario", lambda name: scenario)
    monkeypatch.setattr(study, "run", fake_run)
    monkeypatch.setattr("orograph.judge.same_cells.same_cells_times_s", lambda folders: {1: 450.0, 3: 150.0})
    args = arguments("field", "--robots", "3,1,3", "--out", str(tmp_path / "new"))
    assert args.main(args) == 0
    rows = json.loads((tmp_path / "new" / STUDY).read_text())["rows"]
    assert [(r["robots"], r["speed_up"], r["paper_s"]) for r in rows] == [(1, 1.0, 445), (3, 3.0, 190)]
    assert "3.00" in (tmp_path / "new" / STUDY_PAGE).read_text()
    printed = capsys.readouterr().out
    assert "150.0" in printed and "[s]" in printed and "[s of simulation" in printed
    assert "2.34" in printed


def test_bad_input_is_found_before_anything_is_made(
    scenario: Scenario, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(study, "load_scenario", lambda name: scenario)
    monkeypatch.setattr(study, "run", lambda *a, **k: pytest.fail("was run"))
    for robots, words in (("1,x", "expected numbers"), ("0,1", "1 to 3"), ("4", "1 to 3")):
        args = arguments("field", "--robots", robots, "--out", str(tmp_path / "new"))
        with pytest.raises(InputError, match=words):
            args.main(args)
    assert not (tmp_path / "new").exists()


def test_a_folder_with_something_in_it_is_refused(tmp_path: Path) -> None:
    (tmp_path / "something").write_text("kept")
    with pytest.raises(InputError, match="not an empty folder"):
        study.new_folder(tmp_path, "field")
    (tmp_path / "file").write_text("")
    with pytest.raises(InputError, match="cannot be written"):
        study.new_folder(tmp_path / "file" / "below", "field")
