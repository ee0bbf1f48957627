"""The durable store: what is committed comes back; what is not whole, not ours or not fitting is refused and kept."""

from __future__ import annotations

import os
import signal
import sqlite3
import subprocess
import sys
import textwrap
from contextlib import closing
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from orograph.messages import REGISTER
from orograph.protocol.epochs import NONCES_KEPT
from orograph.protocol.store import (
    CONFIDENT,
    Changes,
    Granted,
    MemoryStore,
    StoreBusy,
    StoreDamaged,
    StoredState,
    StoreFailed,
    StoreFull,
)
from orograph.storage.sqlite_store import SqliteStore

SHAPE = (20, 30)


def rows(cells, seq=1) -> np.ndarray:
    out = np.zeros(len(cells), REGISTER)
    out["cell"], out["seq"], out["height"], out["confidence"] = cells, seq, -5, 9
    return out


def confident(*pairs) -> np.ndarray:
    return np.array(list(pairs), CONFIDENT)


def assert_same(a: StoredState, b: StoredState) -> None:
    assert (a.manager_epoch, a.version, sorted(a.granted, key=repr)) == (
        b.manager_epoch, b.version, sorted(b.granted, key=repr),
    )  # fmt: skip
    assert sorted(a.registers) == sorted(b.registers)
    for robot in a.registers:
        one, two = (np.sort(x.registers[robot], order="cell") for x in (a, b))
        assert np.array_equal(one, two)
    assert sorted(a.confident.tolist()) == sorted(b.confident.tolist())


SOME = Changes(1, 1, {1: rows([3, 4]), 2: rows([3])}, (Granted(1, b"n" * 16, 1),), confident((3, 77)))


@pytest.fixture
def path(tmp_path):
    return tmp_path / "map.sqlite"


def reopened(path) -> StoredState:
    store = SqliteStore(path, SHAPE)
    store.close()
    return store.load()


def filled(path) -> Path:
    store = SqliteStore(path, SHAPE)
    store.commit(SOME)
    store.commit(Changes(1, 2, {1: rows([4, 5], seq=2)}))
    store.close()
    return path


def test_new_store_is_empty(path):
    assert_same(reopened(path), StoredState())
    assert_same(reopened(path), StoredState())


def test_store_whose_making_was_cut_short_is_made_again(path):
    db = sqlite3.connect(path)
    db.execute("pragma journal_mode = wal")
    db.close()
    assert path.stat().st_size > 0
    assert_same(reopened(path), StoredState())


changes = st.builds(
    lambda version, robot, cells, seq: Changes(1, version, {robot: rows(sorted(cells), seq)}),
    st.integers(1, 100), st.integers(1, 3), st.sets(st.integers(0, 599), min_size=1, max_size=20), st.integers(1, 9),
)  # fmt: skip


@settings(max_examples=20, deadline=None)
@given(st.lists(changes, max_size=6))
def test_holds_what_the_memory_store_holds(tmp_path_factory, commits):
    path, memory = tmp_path_factory.mktemp("store") / "map.sqlite", MemoryStore()
    store = SqliteStore(path, SHAPE)
    for each in (SOME, *commits):
        store.commit(each)
        memory.commit(each)
    store.close()
    assert_same(reopened(path), memory.load())


def test_old_nonces_are_forgotten(path):
    store = SqliteStore(path, SHAPE)
    for epoch in range(1, NONCES_KEPT + 10):
        store.commit(Changes(1, 0, granted=(Granted(1, epoch.to_bytes(16, "big"), epoch),)))
    store.close()
    assert [g.epoch for g in reopened(path).granted] == list(range(10, NONCES_KEPT + 10))


def test_another_grid_is_refused(path):
    filled(path)
    with pytest.raises(StoreDamaged, match="20 x 30"):
        SqliteStore(path, (30, 20))


def test_foreign_files_are_refused_and_kept(path):
    path.write_bytes(b"not a database at all" * 100)
    before = path.read_bytes()
    with pytest.raises(StoreDamaged):
        SqliteStore(path, SHAPE)
    assert path.read_bytes() == before
    path.unlink()
    with closing(sqlite3.connect(path)) as other:
        other.execute("create table x (y)")
    with pytest.raises(StoreDamaged, match="not a map store"):
        SqliteStore(path, SHAPE)


def test_another_schema_is_refused(path):
    filled(path)
    db = sqlite3.connect(path)
    db.execute("pragma user_version = 7")
    db.close()
    with pytest.raises(StoreDamaged, match="version 7"):
        SqliteStore(path, SHAPE)


@pytest.mark.parametrize(
    "harm",
    [
        "delete from register where cell = 3 and robot = 1",
        "delete from hello",
        "update map set version = 1",
        "update register set robot = 3 where robot = 2",
        "update register set checksum = checksum + 1 where cell = 5",
        "update confident set stamp_ns = 78",
        "delete from confident",
        "delete from map",
    ],
)
def test_rows_that_vanish_or_change_are_found(path, harm):
    filled(path)
    db = sqlite3.connect(path)
    db.execute(harm)
    db.commit()
    db.close()
    with pytest.raises(StoreDamaged):
        SqliteStore(path, SHAPE)


def test_flipped_bits_are_found_or_harmless(path):
    """Single flips anywhere in the file: either it is refused, or what comes out is what went in."""
    whole, expected = filled(path).read_bytes(), reopened(path)
    rng, refused = np.random.default_rng(1), 0
    names = range(whole.index(b"create table".upper()) * 8, whole.index(b"create table".upper()) * 8 + 400)
    for position in [*rng.integers(0, len(whole) * 8, 300).tolist(), *names]:
        broken = bytearray(whole)
        broken[position // 8] ^= 1 << position % 8
        for left in path.parent.glob("map.sqlite*"):
            left.unlink()
        path.write_bytes(broken)
        try:
            held = reopened(path)
        except StoreDamaged:
            refused += 1
            continue
        assert_same(held, expected)
    assert refused > 0


def test_full_disk_keeps_nothing_of_the_commit_and_goes_on(path):
    store = SqliteStore(filled(path), SHAPE)
    pages = store._number("pragma page_count")
    store._db.execute(f"pragma max_page_count = {pages}")
    with pytest.raises(StoreFull):
        store.commit(Changes(1, 3, {5: rows(range(600))}))
    store._db.execute("pragma max_page_count = 100000")
    store.commit(Changes(1, 3, {5: rows(range(500))}))
    store.close()
    held = reopened(path)
    assert held.version == 3 and len(held.registers[5]) == 500


def test_failed_write_is_told_as_such(path):
    store = SqliteStore(path, SHAPE)
    store._db.execute("drop table confident")
    with pytest.raises(StoreFailed):
        store.commit(SOME)
    store.close()


def test_errors_of_the_module_itself_are_told_as_such(path):
    store = SqliteStore(path, SHAPE)
    store.close()
    with pytest.raises(StoreFailed, match="closed"):
        store.commit(SOME)


def test_a_folder_that_is_not_there_is_told_as_such(tmp_path):
    with pytest.raises(StoreFailed, match="folder"):
        SqliteStore(tmp_path / "none" / "map.sqlite", SHAPE)


def test_load_knows_what_was_committed_since_the_store_was_opened(path):
    store = SqliteStore(filled(path), SHAPE)
    store.commit(Changes(2, 3, {2: rows([9], seq=3)}, confident=confident((9, 5))))
    held = store.load()
    assert (held.manager_epoch, held.version) == (2, 3) and 9 in held.registers[2]["cell"] and len(held.confident) == 2
    store.close()
    assert_same(held, reopened(path))


def test_kill_keeps_every_commit_that_returned(path):
    writer = textwrap.dedent("""
        import sys
        from pathlib import Path
        import numpy as np
        from orograph.storage.sqlite_store import SqliteStore
        from orograph.messages import REGISTER
        from orograph.protocol.store import Changes
        store = SqliteStore(Path(sys.argv[1]), (20, 30))
        for version in range(1, 10_000):
            rows = np.zeros(50, REGISTER)
            rows["cell"], rows["seq"] = np.arange(50) + version % 500, version
            store.commit(Changes(1, version, {1: rows}))
            print(version, flush=True)
    """)
    with subprocess.Popen([sys.executable, "-c", writer, str(path)], stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        told = [int(process.stdout.readline()) for _ in range(20)]
        os.kill(process.pid, signal.SIGKILL)
        told += [int(line) for line in process.stdout if line.endswith("\n")]
    held = reopened(path)
    assert held.version >= told[-1] and int(held.registers[1]["seq"].max()) == held.version


def test_a_second_process_is_told_to_wait_and_not_to_move_the_file(path, monkeypatch):
    monkeypatch.setattr("orograph.storage.sqlite_store.HOLD_TIMEOUT_S", 0.05)
    store = SqliteStore(filled(path), SHAPE)
    with pytest.raises(StoreBusy, match="Wait until it ends, or end it") as refused:
        SqliteStore(path, SHAPE)
    assert "move" not in str(refused.value)
    store.close()
    assert reopened(path).version == 2


# --- harm to the files while nobody holds them ---------------------------------------------------------------------


def killed_after_a_commit(path) -> dict[str, bytes]:
    """The store's files as kill -9 leaves them after acknowledged commits."""
    store = SqliteStore(path, SHAPE)
    for version in range(1, 9):
        cells = (np.arange(60) + 37 * version) % 600
        store.commit(
            Changes(1, version, {version % 3 + 1: rows(np.sort(cells), version)}, confident=confident((version, 7)))
        )
    left = {file.name: file.read_bytes() for file in path.parent.glob("map.sqlite*")}
    store.close()
    return left


def killed_within_a_commit(path) -> dict[str, bytes]:
    """The same, killed while the ninth commit was half written: a tiny cache spills pages before the commit."""
    SqliteStore(path, SHAPE).close()
    left: dict[str, bytes] = {}
    killed_after_a_commit(path)
    store = SqliteStore(path, SHAPE)
    store._db.execute("pragma cache_size = 4")

    def look(statement: str) -> None:
        if statement == "commit":
            left.update({file.name: file.read_bytes() for file in path.parent.glob("map.sqlite*")})

    store._db.set_trace_callback(look)
    store.commit(Changes(1, 9, {1: rows(range(600), 9)}))
    store.close()
    assert len(left["map.sqlite-journal"]) > 4096 and left["map.sqlite"] != path.read_bytes()
    return left


def put(path, files: dict[str, bytes]) -> None:
    for old in path.parent.glob("map.sqlite*"):
        old.unlink()
    for name, content in files.items():
        (path.parent / name).write_bytes(content)


def harmed(files: dict[str, bytes], rng: np.random.Generator) -> tuple[str, dict[str, bytes]]:
    """One file with a flipped bit, cut short, or gone."""
    name = str(rng.choice([name for name, content in files.items() if content]))
    content = bytearray(files[name])
    at = int(rng.integers(len(content)))
    match int(rng.integers(5)):
        case 0:
            return f"{name} gone", {other: files[other] for other in files if other != name}
        case 1:
            return f"{name} cut to {at}", {**files, name: bytes(content[:at])}
        case _:
            content[at] ^= 1 << int(rng.integers(8))
            return f"{name} flipped at {at}", {**files, name: bytes(content)}


@pytest.mark.parametrize("killed", [killed_after_a_commit, killed_within_a_commit])
def test_harmed_files_are_refused_or_hold_all_that_was_acknowledged(path, killed):
    """Or the map itself is gone, and a new one is empty: never an older one in silence."""
    files, rng, refused = killed(path), np.random.default_rng(9), 0
    put(path, files)
    acknowledged = reopened(path)
    assert acknowledged.version == 8
    for _ in range(150):
        what, broken = harmed(files, rng)
        put(path, broken)
        try:
            held = reopened(path)
        except StoreDamaged:
            refused += 1
            continue
        if broken.get("map.sqlite"):
            assert held.version == 8, f"{what}: version {held.version}"
            assert_same(held, acknowledged)
        else:
            assert held.version == 0, what
    assert 20 < refused < 150


def test_a_revoked_robot_s_registers_go_and_its_number_stays(path):
    kept, gone = SqliteStore(path, SHAPE), MemoryStore()
    for store in (kept, gone):
        store.commit(SOME)
        store.commit(Changes(1, 2, confident=confident((3, -1)), revoked=(1,)))
    kept.close()
    again = reopened(path)
    assert sorted(again.registers) == [2] == sorted(gone.load().registers) and again.revoked == (1,)
    assert again.confident.tolist() == [(3, -1)] and again.granted == SOME.granted
