"""`orograph revoke`: of a run folder's store, and of a mission by its map manager's answer over a real router."""

from __future__ import annotations

import threading
from collections.abc import Callable
from contextlib import closing
from pathlib import Path

import numpy as np
import pytest
from orograph import keys
from orograph.cli import revoke
from orograph.cli.main import main
from orograph.comms.bus import Bus
from orograph.control import Revoke, Revoked
from orograph.messages import REGISTER, UPDATE
from orograph.protocol.fold import fold, whole_prior
from orograph.protocol.store import Changes
from orograph.protocol.tiles import map_hash
from orograph.rules import Rules
from orograph.scenario import Scenario
from orograph.scene.prior import prior_records
from orograph.storage.run_folder import SCENARIO, STORE, node_file, write_arrays, write_whole
from orograph.storage.sqlite_store import SqliteStore
from polling import until


def line(capsys: pytest.CaptureFixture[str], code: int, *argv: str) -> str:
    assert main(["revoke", *argv]) == code
    out, err = capsys.readouterr()
    told = err if code else out
    assert told.count("\n") == 1 and not (out if code else err)
    return told


# --- a run folder -------------------------------------------------------------------------------------------------


@pytest.fixture
def run(tmp_path: Path, scenario_of: Callable[..., Scenario]) -> Path:
    scenario = scenario_of(robots=2, starts=[{"x_m": 50, "y_m": 50}, {"x_m": 60, "y_m": 50}])
    write_whole(tmp_path / SCENARIO, scenario.model_dump_json())
    rows = np.zeros(2, REGISTER)
    rows["cell"], rows["epoch"], rows["seq"], rows["height"], rows["confidence"] = [7, 8], 1, [1, 2], 120, 200
    prior = whole_prior(prior_records(scenario), scenario.grid.grid.size)
    glrm = fold(prior, np.zeros((1, len(prior)), UPDATE), Rules.of(scenario.rules))
    glrm["height"][7:9] = 120
    write_arrays(tmp_path / node_file(keys.MANAGER), {"glrm": glrm, "acked_records": np.array([2, 1])})
    with closing(SqliteStore(tmp_path / STORE, scenario.grid.grid.shape)) as store:
        store.commit(Changes(5, 9, {1: rows, 2: rows[:1]}))
    return tmp_path


def test_a_folder_s_map_is_the_one_without_the_robot(run: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert "2 cells" in line(capsys, 0, "robot_001", "--run", str(run))
    scenario = Scenario.model_validate_json((run / SCENARIO).read_text())
    with closing(SqliteStore(run / STORE, scenario.grid.grid.shape)) as store:
        held = store.load()
    assert (held.manager_epoch, held.version, held.revoked, list(held.registers)) == (5, 10, (1,), [2])
    with np.load(run / node_file(keys.MANAGER)) as left:
        assert left["revoked"].tolist() == [1] and left["registers"]["robot"].tolist() == [2]
        assert left["glrm_hash"].tobytes() == map_hash(left["glrm"]) != map_hash(left["glrm_at_end"])
        assert left["acked_records"].tolist() == [2, 1] and left["version"] == 10
    assert "0 cells" in line(capsys, 0, "robot_001", "--run", str(run))


def test_a_robot_or_folder_that_there_is_not_is_one_line(
    run: Path, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    assert "not in this run of 2 robots" in line(capsys, 2, "robot_009", "--run", str(run))
    assert "expected a robot's name" in line(capsys, 2, "2", "--run", str(run))
    assert "is it the folder" in line(capsys, 2, "robot_001", "--run", str(tmp_path / "none")).replace(
        f"is {tmp_path / 'none'} the", "is it the"
    )


# --- a running mission --------------------------------------------------------------------------------------------


def test_it_asks_until_the_manager_says_that_it_is_done(
    router: str, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(revoke, "CONFIRMED_WITHIN_S", 1.0)
    with Bus.open(router, router, threading.Event()) as bus:
        assert "no map manager answers" in line(capsys, 1, "robot_002", "--router", router)
        asked: list[str] = []

        def answer(question: Revoke) -> Revoked:
            asked.append(question.robot)
            if question.robot == "robot_009":
                return Revoked((), "robot_009 is not in this run of 2 robots")
            return Revoked(("robot_002",) if len(asked) > 2 else (), "")

        bus.answer_each(keys.REVOKE, Revoke, answer, keys.RADIO)
        known = lambda: bus.ask(keys.REVOKE, Revoke("robot_001"), Revoked, 5.0, keys.RADIO) is not None  # noqa: E731
        until(known, "nobody answers")
        asked.clear()
        assert "robot_002 is revoked" in line(capsys, 0, "robot_002", "--router", router)
        assert asked == ["robot_002"] * 3
        assert "not in this run" in line(capsys, 2, "robot_009", "--router", router)
        assert "has not done it" in line(capsys, 1, "robot_001", "--router", router)
