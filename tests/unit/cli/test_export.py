from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import yaml
from made_up.run import leave
from orograph import keys
from orograph.cli.main import main
from orograph.grid import Grid
from orograph.layers import CellMap
from orograph.nodes.cell_history import CHANGE
from orograph.registers import unpack
from orograph.storage.parts import RunParts
from orograph.storage.recorded_map import map_arrays
from orograph.storage.run_folder import GLRM, SCENARIO, write_arrays


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


def test_the_map_at_many_times_ends_as_it_ended(
    city_run: RunParts, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    from mcap.reader import make_reader
    from mcap_ros2.decoder import DecoderFactory

    manager = city_run.of(keys.MANAGER)
    seen = manager["glrm"]
    stamps_ns = np.sort(np.random.default_rng(1).integers(0, city_run.run.sim_time_s * 1e9, len(seen)))
    changes = np.zeros(len(seen), CHANGE)
    changes["stamp_ns"] = stamps_ns
    for name in seen.dtype.names:
        changes[name] = seen[name]
    nodes = {**city_run.nodes, keys.MANAGER: {**manager, "changes": changes}}
    leave(replace(city_run, nodes=nodes), tmp_path / "run")
    last = unpack(manager["glrm"], city_run.glrm_grid)
    write_arrays(tmp_path / "run" / GLRM, map_arrays(last))
    every_s = city_run.run.sim_time_s / 4
    options = ["--to", "npz,mcap", "--every", f"{every_s}s"]
    assert main(["export", str(tmp_path / "run"), *options]) == 0
    files = [Path(line) for line in capsys.readouterr().out.splitlines()]
    assert len(files) == 6 and files[-1].name == "glrm.mcap"
    known = []
    for path in files[:5]:
        with np.load(path) as held:
            known.append(int((held["confidence"] > 0).sum()))
            height = held["height"]
    assert known == sorted(known)
    assert np.array_equal(height, np.where(last.confidence > 0, last.height, np.nan), equal_nan=True)
    with files[-1].open("rb") as stream:
        read = list(make_reader(stream, decoder_factories=[DecoderFactory()]).iter_decoded_messages(["/map"]))
    assert [message.log_time for _, _, message, _ in read] == [
        *(round(i * every_s * 1e9) for i in range(4)), round(city_run.run.sim_time_s * 1e9)
    ]  # fmt: skip


@pytest.mark.parametrize(("options", "words"), [
    (["--to", "npz", "--every", "often"], "--every often: expected seconds"),
    (["--to", "npz", "--every", "10s"], "keeps no course of its map"),
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


def test_a_run_of_another_version_is_named(run_folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    scenario = json.loads((run_folder / SCENARIO).read_text())
    (run_folder / SCENARIO).write_text(json.dumps({**scenario, "rules": "default"}))
    assert main(["export", str(run_folder), "--to", "npz"]) == 2
    told = capsys.readouterr().err
    assert "scenario.json: rules" in told and "another version" in told and told.count("\n") == 1
