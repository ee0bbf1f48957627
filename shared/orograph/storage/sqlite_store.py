"""The Map Manager's durable store: SQLite, WAL mode, synchronous=FULL (protocol.md, "Storage").

One row per register with a checksum of its own, and one sum over all rows, so that a flipped bit or a vanished row is
found when the store is opened and never served. SQLite's WAL frames carry checksums themselves.
"""

from __future__ import annotations

import sqlite3
import zlib
from collections.abc import Callable
from contextlib import AbstractContextManager, nullcontext
from pathlib import Path

import numpy as np

from orograph.arrays import I64
from orograph.messages import REGISTER, Packed
from orograph.protocol.epochs import NONCES_KEPT
from orograph.protocol.store import CONFIDENT, Changes, Granted, StoreDamaged, StoredState, StoreFailed, StoreFull

APPLICATION_ID = 0x4F524F47
SCHEMA_VERSION = 1
Timed = Callable[[], AbstractContextManager[object]]
HOLD_TIMEOUT_S = 5.0
"""How long a predecessor that is just ending may keep the file."""

_TABLES = (
    "create table map (rows integer, cols integer, manager_epoch integer, version integer, checksum integer)",
    "create table register (robot integer, cell integer, record blob, checksum integer,"
    " primary key (robot, cell)) without rowid",
    "create table hello (robot integer, epoch integer, nonce blob, checksum integer,"
    " primary key (robot, epoch)) without rowid",
    "create table confident (cell integer primary key, stamp_ns integer, checksum integer)",
)


def _checksum(*parts: int | bytes) -> int:
    joined = b"".join(part if isinstance(part, bytes) else part.to_bytes(8, "little", signed=True) for part in parts)
    return zlib.crc32(joined)


class SqliteStore:
    """Implements `protocol.store.Store` on the file `path` for a map of `shape`; one process at a time.

    Raises StoreDamaged when the file is not whole, not ours, for another grid, or held by another process.
    """

    def __init__(self, path: Path, shape: tuple[int, int], timed: Timed = nullcontext) -> None:
        """`timed` makes the context in which each commit runs."""
        self._path, self._shape, self._timed = path, shape, timed
        self._register_sums: dict[int, I64] = {}
        self._hello_sums: dict[tuple[int, int], int] = {}
        try:
            self._db = sqlite3.connect(path, isolation_level=None, timeout=HOLD_TIMEOUT_S)
        except sqlite3.Error as error:
            raise self._refusal(str(error)) from error
        try:
            self._open()
            self._held = self._read()
        except StoreDamaged:
            self._db.close()
            raise
        except (
            Exception
        ) as error:  # a flipped bit shows as anything: a text that is none, a missing column, a wrong type
            self._db.close()
            raise self._refusal(f"it cannot be read ({error})") from error

    def _refusal(self, why: str) -> StoreDamaged:
        return StoreDamaged(f"{self._path}: {why}. The file is kept as it is; move it away to start with an empty map.")

    def _open(self) -> None:
        self._db.execute("pragma locking_mode = exclusive")
        new = self._number("select count(*) from sqlite_master") == 0
        if not new and self._number("pragma application_id") != APPLICATION_ID:
            raise self._refusal("this is not a map store")
        self._db.execute("pragma journal_mode = wal")
        self._db.execute("pragma synchronous = full")
        if new:
            self._create()
        if (found := self._number("pragma user_version")) != SCHEMA_VERSION:
            raise self._refusal(f"its schema is version {found}, this program writes {SCHEMA_VERSION}")
        problems = [row[0] for row in self._db.execute("pragma integrity_check(1)")]
        if problems != ["ok"]:
            raise self._refusal(f"it is damaged ({problems[0]})")

    def _create(self) -> None:
        """One transaction, so that a crash leaves either nothing or a whole empty store."""
        self._db.execute("begin immediate")
        for statement in _TABLES:
            self._db.execute(statement)
        self._db.execute("insert into map values (?, ?, 0, 0, ?)", (*self._shape, self._head_checksum(0, 0, 0)))
        self._db.execute(f"pragma application_id = {APPLICATION_ID}")
        self._db.execute(f"pragma user_version = {SCHEMA_VERSION}")
        self._db.execute("commit")

    def _number(self, query: str) -> int:
        return int(self._db.execute(query).fetchone()[0])

    def _head_checksum(self, manager_epoch: int, version: int, total: int) -> int:
        return _checksum(*self._shape, manager_epoch, version, total)

    def close(self) -> None:
        """Give the file back."""
        self._db.close()

    def load(self) -> StoredState:
        """All that had been committed when the store was opened."""
        return self._held

    # --- reading -----------------------------------------------------------------------------------------------------

    def _read(self) -> StoredState:
        heads = self._db.execute("select * from map").fetchall()
        if len(heads) != 1:
            raise self._refusal("it is damaged (no head)")
        rows, cols, manager_epoch, version, checksum = heads[0]
        if (rows, cols) != self._shape:
            raise self._refusal(f"it holds a map of {rows} x {cols} cells, this scenario has {self._shape}")
        registers, granted, confident = self._read_registers(), self._read_granted(), self._read_confident()
        if checksum != self._head_checksum(manager_epoch, version, self._total()):
            raise self._refusal("it is damaged (the sum over its rows does not match)")
        return StoredState(manager_epoch, version, registers, granted, confident)

    def _total(self) -> int:
        return sum(int(sums.sum()) for sums in self._register_sums.values()) + sum(self._hello_sums.values())

    def _verify(self, table: str, key: tuple[int, int], checksum: int, content: int | bytes) -> None:
        if checksum != _checksum(*key, content):
            raise self._refusal(f"it is damaged ({table} {key} does not match its checksum)")

    def _sums_of(self, robot: int) -> I64:
        return self._register_sums.setdefault(robot, np.zeros(self._shape[0] * self._shape[1], np.int64))

    def _read_registers(self) -> dict[int, Packed]:
        blobs: dict[int, list[bytes]] = {}
        for robot, cell, record, checksum in self._db.execute("select * from register"):
            self._verify("register", (robot, cell), checksum, record)
            self._sums_of(robot)[cell] = checksum
            blobs.setdefault(robot, []).append(record)
        return {robot: np.frombuffer(b"".join(parts), REGISTER) for robot, parts in blobs.items()}

    def _read_granted(self) -> tuple[Granted, ...]:
        granted = []
        for robot, epoch, nonce, checksum in self._db.execute("select * from hello"):
            self._verify("hello", (robot, epoch), checksum, nonce)
            self._hello_sums[robot, epoch] = checksum
            granted.append(Granted(robot, nonce, epoch))
        return tuple(granted)

    def _read_confident(self) -> Packed:
        found = self._db.execute("select * from confident").fetchall()
        for cell, stamp_ns, checksum in found:
            self._verify("confident", (cell, 0), checksum, stamp_ns)
        return np.array([(cell, stamp_ns) for cell, stamp_ns, _ in found], CONFIDENT)

    # --- writing -----------------------------------------------------------------------------------------------------

    def commit(self, changes: Changes) -> None:
        """Keep these durably before returning; raises StoreFull (nothing kept) or StoreFailed (end the process)."""
        registers = {robot: [_register_row(robot, row) for row in rows] for robot, rows in changes.registers.items()}
        hellos = {(g.robot, g.epoch): _checksum(g.robot, g.epoch, g.nonce) for g in changes.granted}
        forgotten = [key for g in changes.granted if (key := (g.robot, g.epoch - NONCES_KEPT)) in self._hello_sums]
        total = self._total_after(registers, hellos, forgotten)
        try:
            with self._timed():
                self._write(changes, registers, forgotten, total)
        except sqlite3.Error as error:
            if error.sqlite_errorcode != sqlite3.SQLITE_FULL:
                raise StoreFailed(f"{self._path}: {error}") from error
            if self._db.in_transaction:
                self._db.execute("rollback")
            raise StoreFull(f"{self._path}: {error}") from error
        for robot, rows in registers.items():
            self._sums_of(robot)[[row[1] for row in rows]] = [row[3] for row in rows]
        self._hello_sums.update(hellos)
        for key in forgotten:
            del self._hello_sums[key]

    def _total_after(
        self, registers: dict[int, list[tuple[int, int, bytes, int]]], hellos: dict[tuple[int, int], int],
        forgotten: list[tuple[int, int]],
    ) -> int:  # fmt: skip
        total = self._total() + sum(hellos.values()) - sum(self._hello_sums[key] for key in forgotten)
        for robot, rows in registers.items():
            replaced = self._sums_of(robot)[[row[1] for row in rows]]
            total += sum(row[3] for row in rows) - int(replaced.sum())
        return total

    def _write(
        self, changes: Changes, registers: dict[int, list[tuple[int, int, bytes, int]]],
        forgotten: list[tuple[int, int]], total: int,
    ) -> None:  # fmt: skip
        self._db.execute("begin immediate")
        for rows in registers.values():
            self._db.executemany("insert or replace into register values (?, ?, ?, ?)", rows)
        hellos = [(g.robot, g.epoch, g.nonce, _checksum(g.robot, g.epoch, g.nonce)) for g in changes.granted]
        self._db.executemany("insert into hello values (?, ?, ?, ?)", hellos)
        self._db.executemany("delete from hello where robot = ? and epoch = ?", forgotten)
        confident = [(cell, stamp, _checksum(cell, 0, stamp)) for cell, stamp in changes.confident.tolist()]
        self._db.executemany("insert or replace into confident values (?, ?, ?)", confident)
        head = (changes.manager_epoch, changes.version)
        self._db.execute(
            "update map set manager_epoch = ?, version = ?, checksum = ?", (*head, self._head_checksum(*head, total))
        )
        self._db.execute("commit")


def _register_row(robot: int, row: np.void) -> tuple[int, int, bytes, int]:
    cell, record = int(row["cell"]), row.tobytes()
    return robot, cell, record, _checksum(robot, cell, record)
