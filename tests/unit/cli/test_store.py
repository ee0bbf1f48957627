"""`orograph store`: what is not whole is said in a line, a backup is whole whatever goes on, nothing newer is lost."""

from __future__ import annotations

import shutil
import subprocess
import sys
import textwrap
from collections.abc import Callable
from contextlib import closing
from pathlib import Path

import numpy as np
import pytest
from orograph.cli.main import main
from orograph.errors import RunError
from orograph.launch.kept_store import check
from orograph.messages import REGISTER, UPDATE, Packed
from orograph.protocol.fold import fold, whole_prior
from orograph.protocol.store import CONFIDENT, Changes, Granted, StoredState
from orograph.protocol.tiles import map_hash
from orograph.rules import Rules
from orograph.scenario import Scenario
from orograph.scene.prior import prior_records
from orograph.storage.run_folder import SCENARIO, STORE, write_whole
from orograph.storage.sqlite_store import SqliteStore

SHAPE = (20, 20)


def told(capsys: pytest.CaptureFixture[str], code: int, *argv: object) -> str:
    """What the command says; one line, and nothing else, where it ends badly."""
    assert main(["store", *map(str, argv)]) == code
    out, err = capsys.readouterr()
    assert not (out if code else err) and (not code or err.count("\n") == 1), out + err
    return err if code else out


def rows(cells: range, seq: int) -> Packed:
    out = np.zeros(len(cells), REGISTER)
    out["cell"], out["seq"], out["epoch"], out["height"], out["confidence"] = cells, seq, 1, 700 + seq, 90
    return out


def commit(path: Path, *changes: Changes) -> None:
    with closing(SqliteStore(path, SHAPE)) as store:
        for each in changes:
            store.commit(each)


def held(path: Path) -> StoredState:
    with closing(SqliteStore(path, SHAPE)) as store:
        return store.load()


def contents(state: StoredState) -> str:
    """Everything in it."""
    registers = {robot: rows.tolist() for robot, rows in sorted(state.registers.items())}
    return repr((state.manager_epoch, state.version, registers, state.granted, state.confident, state.revoked))


@pytest.fixture
def run(tmp_path: Path, scenario_of: Callable[..., Scenario]) -> Path:
    """A run folder with seven versions: two robots in the map, and one that was revoked."""
    scenario = scenario_of(robots=3, starts=[{"x_m": 40 + 5 * i, "y_m": 50} for i in range(3)])
    out = tmp_path / "run"
    write_whole(out / SCENARIO, scenario.model_dump_json())
    granted = tuple(Granted(robot, bytes([robot]) * 16, 1) for robot in (1, 2, 3))
    commit(
        out / STORE,
        Changes(5, 6, {1: rows(range(300), 1), 2: rows(range(200, 400), 2), 3: rows(range(9), 3)}, granted,
                np.array([(3, 77)], CONFIDENT)),
        Changes(5, 7, revoked=(3,)),
    )  # fmt: skip
    return out


# --- check ----------------------------------------------------------------------------------------------------------


def test_a_whole_store_is_told_with_its_run_and_the_hash_of_its_map(
    run: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    scenario = Scenario.model_validate_json((run / SCENARIO).read_text())
    columns = np.zeros((2, 400), REGISTER)
    columns[0, :300], columns[1, 200:] = rows(range(300), 1), rows(range(200, 400), 2)
    prior = whole_prior(prior_records(scenario), 400)
    glrm = fold(prior, columns, Rules.of(scenario.rules)) if len(prior) else np.zeros(0, UPDATE)
    before = (run / STORE).read_bytes()
    said = told(capsys, 0, "check", run)
    for words in (
        "square, seed 1, 3 robots", "version 7 in life 5", "400 with 500 registers", "robot_003\n",
        map_hash(glrm).hex(), "robot_001  300", "robot_002  200",
    ):  # fmt: skip
        assert words in said, said
    assert (run / STORE).read_bytes() == before
    assert told(capsys, 0, "check", run / STORE) == said
    shutil.copy(run / STORE, run / "lone.sqlite")
    assert "version 7 in life 5" in told(capsys, 0, "check", run / "lone.sqlite")


def refusal(path: Path, content: bytes, expected: str) -> str:
    """What `check` says of a file with this content; nothing where it takes it, and then it holds what is expected."""
    path.write_bytes(content)
    try:
        assert contents(check(path).held) == expected
    except RunError as error:
        return str(error)
    return ""


def test_200_flipped_bytes_and_cuts_are_found_or_change_nothing(run: Path, tmp_path: Path) -> None:
    """A flip in a row is always found, so is a cut; only where SQLite keeps nothing a flip is harmless."""
    whole, expected = (run / STORE).read_bytes(), contents(held(run / STORE))
    broken, rng = tmp_path / "broken.sqlite", np.random.default_rng(12)
    records = [whole.index(row.tobytes()) for row in rng.choice(held(run / STORE).registers[1], 100, replace=False)]
    in_rows = [at + int(rng.integers(REGISTER.itemsize)) for at in records]
    for number, at in enumerate([*in_rows, *rng.integers(len(whole), size=60).tolist()]):
        flipped = bytearray(whole)
        flipped[at] ^= int(rng.integers(1, 256))
        said = refusal(broken, bytes(flipped), expected)
        assert "\n" not in said and (said.startswith(f"{broken}: ") or (number >= len(in_rows) and not said)), at
    for size in (0, 1, 99, 100, *rng.integers(len(whole), size=36).tolist()):
        said = refusal(broken, whole[:size], expected)
        assert said.startswith(f"{broken}: ") and "\n" not in said, size


def test_damage_is_told_with_its_place(run: Path, capsys: pytest.CaptureFixture[str]) -> None:
    whole = (run / STORE).read_bytes()
    at = whole.index(rows(range(200, 201), 2).tobytes())
    (run / STORE).write_bytes(whole[: at + 9] + bytes([whole[at + 9] ^ 1]) + whole[at + 10 :])
    said = told(capsys, 1, "check", run)
    assert f"{run / STORE}: it is damaged (a row of table register" in said and "robots that live fill again" in said


def test_bad_input_is_one_line(
    run: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], scenario_of: Callable[..., Scenario]
) -> None:
    assert "is not there" in told(capsys, 2, "check", tmp_path / "none")
    assert "is not there" in told(capsys, 2, "backup", tmp_path, "--to", tmp_path / "new")
    assert "the folder of a run" in told(capsys, 2, "restore", run / STORE, "--to", tmp_path / "none")
    assert "cannot be written" in told(capsys, 2, "backup", run, "--to", run / STORE / "below")
    (tmp_path / "text").write_text("what is this?" * 100)
    assert "not a database" in told(capsys, 1, "check", tmp_path / "text")
    write_whole(run / SCENARIO, scenario_of(grid={"rows": 30, "cols": 20}).model_dump_json())
    assert "20 x 20 cells" in told(capsys, 1, "check", run)
    write_whole(run / SCENARIO, "{}")
    assert "another version" in told(capsys, 2, "check", run)


# --- backup ---------------------------------------------------------------------------------------------------------

COMMITS_ON = textwrap.dedent("""
    import sys
    from pathlib import Path
    import numpy as np
    from orograph.messages import REGISTER
    from orograph.protocol.store import Changes
    from orograph.storage.sqlite_store import SqliteStore
    store = SqliteStore(Path(sys.argv[1]), (20, 20))
    for version in range(8, 1_000_000):
        rows = np.zeros(400, REGISTER)
        rows["cell"], rows["epoch"], rows["seq"] = np.arange(400), 1, version
        store.commit(Changes(5, version, {1: rows}))
        print(version, flush=True)
""")


def test_a_backup_of_a_store_in_which_commits_go_on_is_one_commit_and_none_that_had_returned_is_missing(
    run: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("orograph.storage.sqlite_store.HOLD_TIMEOUT_S", 0.05)
    argv = [sys.executable, "-c", COMMITS_ON, str(run / STORE)]
    with subprocess.Popen(argv, stdout=subprocess.PIPE, text=True) as manager:
        assert manager.stdout is not None
        try:
            for number in range(5):
                returned, to = int(manager.stdout.readline()), tmp_path / f"backup-{number}"
                assert "whole copy" in told(capsys, 0, "backup", run, "--to", to)
                state = held(to)
                assert state.version >= returned and set(state.registers[1]["seq"]) == {state.version}
            assert "another process holds it" in told(capsys, 1, "restore", tmp_path / "backup-0", "--to", run)
        finally:
            manager.kill()
    assert held(run / STORE).version >= held(tmp_path / "backup-4").version


def test_no_backup_is_written_over_and_none_is_made_of_what_is_damaged(
    run: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    to = tmp_path / "kept" / "backup.sqlite"
    told(capsys, 0, "backup", run, "--to", to)
    before = to.read_bytes()
    assert "no backup is written over" in told(capsys, 2, "backup", run, "--to", to)
    (run / STORE).write_bytes(before[:-5000])
    assert "damaged" in told(capsys, 1, "backup", run, "--to", tmp_path / "kept" / "other").replace(
        "malformed", "damaged"
    )
    assert [path.name for path in to.parent.iterdir()] == ["backup.sqlite"] and to.read_bytes() == before


# --- restore --------------------------------------------------------------------------------------------------------


@pytest.fixture
def backup(run: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> Path:
    told(capsys, 0, "backup", run, "--to", tmp_path / "backup.sqlite")
    return tmp_path / "backup.sqlite"


def test_what_is_newer_goes_only_by_force_and_what_that_loses_is_told(
    run: Path, backup: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    commit(run / STORE, Changes(5, 8, {1: rows(range(4), 9)}), Changes(5, 9, revoked=(2,)))
    newer = contents(held(run / STORE))
    said = told(capsys, 2, "restore", backup, "--to", run)
    for words in ("versions 8 to 9", "4 newer registers", "the revocation of robot_002", "--force"):
        assert words in said
    assert contents(held(run / STORE)) == newer
    said = told(capsys, 0, "restore", backup, "--to", run, "--force")
    assert "lost: versions 8 to 9, 4 newer registers, the revocation of robot_002" in said and "revoke again" in said
    assert contents(held(run / STORE)) == contents(held(backup))


def test_evidence_of_another_life_with_a_lower_version_is_newer_too(
    run: Path, backup: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (run / STORE).unlink()
    commit(run / STORE, Changes(44, 1, {2: rows(range(5), 9)}))
    assert "does not: 5 newer registers." in told(capsys, 2, "restore", backup, "--to", run)


def test_what_is_older_or_the_same_is_replaced(run: Path, backup: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert "lost" not in told(capsys, 0, "restore", backup, "--to", run)
    (run / STORE).unlink()
    commit(run / STORE, Changes(5, 1, {1: rows(range(5), 0), 3: rows(range(5), 3)}))
    assert "lost" not in told(capsys, 0, "restore", backup, "--to", run)
    assert contents(held(run / STORE)) == contents(held(backup))


def journal_of_a_commit(path: Path) -> bytes:
    """What lies beside a store within a commit: its pages as they were, to be played back."""
    left = b""

    def look(statement: str) -> None:
        nonlocal left
        if statement == "commit":
            left = path.with_name(f"{path.name}-journal").read_bytes()

    commit(path, Changes(5, 8, {2: rows(range(400), 8)}))
    with closing(SqliteStore(path, SHAPE)) as store:
        store._db.execute("pragma cache_size = 4")
        store._db.set_trace_callback(look)
        store.commit(Changes(5, 9, {1: rows(range(400), 9)}))
    assert len(left) > 4096
    return left


@pytest.mark.parametrize("there", [b"", None])
def test_no_journal_of_a_store_that_is_gone_is_played_into_the_backup(
    run: Path, backup: Path, capsys: pytest.CaptureFixture[str], there: bytes | None
) -> None:
    journal = journal_of_a_commit(run / STORE)
    (run / STORE).unlink() if there is None else (run / STORE).write_bytes(there)
    (run / f"{STORE}-journal").write_bytes(journal)
    told(capsys, 0, "restore", backup, "--to", run)
    assert contents(held(run / STORE)) == contents(held(backup))


def test_a_damaged_store_is_moved_aside(run: Path, backup: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for number in (1, 2):
        (run / STORE).write_bytes(b"rot" * 3000)
        aside = run / f"{STORE}.damaged-{number:03d}"
        assert str(aside) in told(capsys, 0, "restore", backup, "--to", run)
        assert aside.read_bytes() == b"rot" * 3000
        assert contents(held(run / STORE)) == contents(held(backup))


def test_a_damaged_backup_is_not_restored(run: Path, backup: Path, capsys: pytest.CaptureFixture[str]) -> None:
    before = (run / STORE).read_bytes()
    backup.write_bytes(backup.read_bytes()[:9000])
    assert "Nothing was restored" in told(capsys, 1, "restore", backup, "--to", run)
    assert (run / STORE).read_bytes() == before and sorted(p.name for p in run.iterdir() if p.is_file())[0] == STORE
