"""What `orograph explain` shows of a run folder's store, and what it says where there is nothing to show."""

from __future__ import annotations

from contextlib import closing
from pathlib import Path

import numpy as np
import pytest
from orograph.cli.main import main
from orograph.messages import REGISTER
from orograph.protocol.store import Changes
from orograph.scenario import Scenario
from orograph.storage.run_folder import SCENARIO, STORE, write_whole
from orograph.storage.sqlite_store import SqliteStore


@pytest.fixture
def run(tmp_path: Path, scenario_of) -> Path:
    """Two robots saw cell 2,3 of a flat square; both say 2 m, the second half a minute later."""
    scenario: Scenario = scenario_of(rules={"half_life_s": 60, "height_gate_m": 1})
    write_whole(tmp_path / SCENARIO, scenario.model_dump_json())
    rows = np.zeros(1, REGISTER)
    rows["cell"], rows["epoch"], rows["seq"], rows["height"], rows["confidence"] = 2 * 20 + 3, 1, 7, 2000, 200
    later = rows.copy()
    later["tick"], later["confidence"] = 60_000, 90
    with closing(SqliteStore(tmp_path / STORE, scenario.grid.grid.shape)) as store:
        store.commit(Changes(1, 1, {1: rows, 2: later}))
    return tmp_path


def lines(capsys: pytest.CaptureFixture[str], *argv: str) -> list[list[str]]:
    assert main(["explain", *argv]) == 0
    return [line.split() for line in capsys.readouterr().out.splitlines() if line.strip()]


@pytest.mark.parametrize("where", [("--cell", "2,3"), ("--at", "19.9,10")])
def test_a_cell_is_told_contribution_by_contribution(run, capsys, where) -> None:
    head, _, prior, one, two, made = lines(capsys, str(run), *where)
    assert " ".join(head) == "cell 2,3 round 17.5,12.5 m: folded from the prior and 2 robots"
    assert prior[:2] == ["prior", "-"]
    assert one[:5] == ["robot_001", "0.0", "s", "1/7", "2.000"] and " ".join(one[-6:]) == "200 -> 100 much surer, taken"
    assert two[:5] == ["robot_002", "60.0", "s", "1/7", "2.000"] and " ".join(two[-4:]) == "90 mean by confidence"
    assert made[:3] == ["the", "map", "2.000"] and made[-1] == "190"


def test_a_cell_that_nobody_saw_is_the_priors(run, capsys) -> None:
    head, *_, made = lines(capsys, str(run), "--cell", "0,0")
    assert " ".join(head).endswith("the prior's alone") and made[:2] == ["the", "map"]


@pytest.mark.parametrize(
    ("argv", "found"),
    [
        (("--cell", "20,0"), "rows are 0 to 19, columns 0 to 19"),
        (("--cell", "-1,0"), "rows are 0 to 19"),
        (("--cell", "3"), "expected ROW,COL"),
        (("--cell", "1,2,3"), "expected ROW,COL"),
        (("--at", "-1,3"), "the map reaches from 0,0 to 100,100"),
        (("--at", "nan,3"), "expected X,Y"),
        (("--at", "here"), "expected X,Y"),
    ],
)
def test_a_cell_that_there_is_not_is_one_line(run, capsys, argv, found) -> None:
    assert main(["explain", str(run), *argv]) == 2
    out, err = capsys.readouterr()
    assert not out and found in err and err.count("\n") == 1


def test_a_folder_without_a_map_is_one_line(run, capsys, tmp_path) -> None:
    assert main(["explain", str(tmp_path / "none"), "--cell", "0,0"]) == 2
    assert "is" in capsys.readouterr().err
    (run / STORE).write_bytes(b"no map" * 1000)
    assert main(["explain", str(run), "--cell", "0,0"]) == 1
    (run / STORE).unlink()
    assert main(["explain", str(run), "--cell", "0,0"]) == 2
    err = capsys.readouterr().err
    assert "kept as it is" in err and "is not there" in err and err.count("\n") == 2 and not (run / STORE).exists()
