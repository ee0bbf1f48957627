"""A folder that cannot be played says why in one line: cut short, of another version, or no run at all."""

from __future__ import annotations

from pathlib import Path

import pytest
from made_up.run import leave
from orograph.cli.main import main
from orograph.storage.parts import RunParts


def refused(capsys: pytest.CaptureFixture[str], out: Path) -> str:
    assert main(["view", str(out)]) == 2
    said = capsys.readouterr().err
    assert said.startswith("orograph: ") and said.count("\n") == 1
    return said


def written(out: Path, run: RunParts) -> Path:
    leave(run, out)
    return out


def test_no_run_at_all(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    assert "the folder of a run?" in refused(capsys, tmp_path)


def test_a_run_that_kept_no_course_of_its_map(
    capsys: pytest.CaptureFixture[str], tmp_path: Path, city_run: RunParts
) -> None:
    assert "keeps no course of its map" in refused(capsys, written(tmp_path, city_run))


def test_a_part_that_was_cut_short(capsys: pytest.CaptureFixture[str], tmp_path: Path, city_run: RunParts) -> None:
    world = written(tmp_path, city_run) / "parts/world.npz"
    world.write_bytes(world.read_bytes()[:-200])
    assert "world.npz: cannot be read" in refused(capsys, tmp_path)


def test_a_scenario_of_another_version(capsys: pytest.CaptureFixture[str], tmp_path: Path, city_run: RunParts) -> None:
    file = written(tmp_path, city_run) / "parts/scenario.json"
    file.write_text(file.read_text().replace('"seed":', '"sown":'))
    assert "of another version" in refused(capsys, tmp_path)
