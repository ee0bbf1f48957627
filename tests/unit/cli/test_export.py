from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import yaml
from made_up.run import leave
from orograph.cli.main import main
from orograph.grid import Grid
from orograph.layers import CellMap
from orograph.storage.parts import RunParts
from orograph.storage.recorded_map import map_arrays
from orograph.storage.run_folder import GLRM, write_arrays


@pytest.fixture
def run_folder(city_run: RunParts, tmp_path: Path) -> Path:
    """A run in a UTM zone, whose map frame begins at (385000, 6672000) there."""
    out = tmp_path / "run"
    placed = {"crs": "EPSG:32635", "crs_origin_m": (385_000.0, 6_672_000.0)}
    scenario = city_run.scenario.model_copy(update=placed)
    leave(replace(city_run, scenario=scenario), out)
    write_arrays(out / GLRM, map_arrays(CellMap.unknown(Grid((10.0, 20.0), 5.0, (4, 6)))))
    return out


def test_a_runs_map_lies_where_its_scenario_says(run_folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["export", str(run_folder), "--to", "pgm,npz"]) == 0
    files = [Path(line) for line in capsys.readouterr().out.splitlines()]
    assert files == [run_folder / "export" / name for name in ("glrm.pgm", "glrm.yaml", "glrm.npz")]
    assert yaml.safe_load(files[1].read_text())["origin"] == [385_010.0, 6_672_020.0, 0.0]
    with np.load(files[2]) as held:
        assert str(held["crs"]) == "EPSG:32635"
    assert main(["export", str(run_folder), "--to", "pgm", "--crs", "EPSG:3067", "--out", str(run_folder / "x")]) == 0
    assert yaml.safe_load((run_folder / "x/glrm.yaml").read_text())["origin"] == [10.0, 20.0, 0.0]


@pytest.mark.parametrize(("options", "words"), [
    (["--to", "dxf"], "--to dxf: dxf is none of geotiff, cog,"),
    (["--to", ","], "--to ,: nothing is none of"),
    (["--to", "npz", "--map", "hrm"], "no map hrm; it holds glrm"),
    (["--to", "npz", "--crs", "here"], "crs here: unknown to PROJ"),
])  # fmt: skip
def test_what_cannot_be_exported_is_said(
    run_folder: Path, capsys: pytest.CaptureFixture[str], options: list[str], words: str
) -> None:
    assert main(["export", str(run_folder), *options]) == 2
    assert words in capsys.readouterr().err
    assert not (run_folder / "export").exists()


def test_a_damaged_map_is_named(run_folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (run_folder / GLRM).write_bytes(b"PK\x03\x04")
    assert main(["export", str(run_folder), "--to", "npz"]) == 2
    assert "glrm.npz: no map that can be read" in capsys.readouterr().err
