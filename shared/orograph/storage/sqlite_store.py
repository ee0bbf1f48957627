"""The Map Manager's durable store: one SQLite file, rollback journal, synchronous=FULL (protocol.md, "Storage").

What a commit acknowledged is in the file itself, synced, before the commit returns; the journal beside it can only undo
a commit that never returned, and is empty in between. A write-ahead log would hold acknowledged commits alone, and
SQLite leaves out of a log, without a word, everything from its first damaged frame on. Every row of every table has a
checksum, and the head one over the sum of them all, so that a flipped bit, a vanished row or a file of which parts are
older than others is found when the store is opened and never served.
"""

from __future__ import annotations

import json
import sqlite3
import zlib
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, closing, nullcontext
from pathlib import Path
from typing import Any

import numpy as np

from orograph.messages import REGISTER, Packed
from orograph.protocol.epochs import NONCES_KEPT
from orograph.protocol.store import (
    CONFIDENT,
    SETTLED,
    Changes,
    Granted,
    StoreBusy,
    StoreDamaged,
    StoredState,
    StoreError,
    StoreFailed,
    StoreFull,
)

APPLICATION_ID = 0x4F524F47
SCHEMA_VERSION = 4
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
    "create table revoked (robot integer primary key, checksum integer)",
    "create table settled (cell integer primary key, surface integer, since_ms integer,"
    " changed_ms integer, top integer, checksum integer)",
)
_PUT_REGISTERS = "insert into register values (?, ?, ?, ?)"
_PUT_HELLOS = "insert into hello values (?, ?, ?, ?)"
_PUT_CONFIDENT = "insert into confident values (?, ?, ?)"
_PUT_SETTLED = "insert into settled values (?, ?, ?, ?, ?, ?)"
_TAKE_SETTLED = "delete from settled where cell in (select value from json_each(?)) returning checksum"
_PUT_REVOKED = "insert into revoked values (?, ?)"
_TAKE_ROBOT = "delete from register where robot = ? returning checksum"
_TAKE_REGISTERS = "delete from register where robot = ? and cell in (select value from json_each(?)) returning checksum"
_TAKE_CONFIDENT = "delete from confident where cell in (select value from json_each(?)) returning checksum"
_TAKE_OLD_HELLOS = (
    "delete from hello where robot = ?1 and epoch <="
    f" (select epoch from hello where robot = ?1 order by epoch desc limit 1 offset {NONCES_KEPT}) returning checksum"
)

Row = tuple[int | bytes, ...]
"""Keys and content of a row, without its checksum."""


def _checksum(*parts: int | bytes) -> int:
    joined = b"".join(part if isinstance(part, bytes) else part.to_bytes(8, "little", signed=True) for part in parts)
    return zlib.crc32(joined)


def _primary_code(error: sqlite3.Error) -> int | None:
    """SQLite's primary result code; None for errors of the Python module itself."""
    code: int | None = getattr(error, "sqlite_errorcode", None)
    return None if code is None else code & 0xFF


def said_shape(path: Path) -> tuple[int, int] | None:
    """(rows, cols) of the map that a store says it holds, not verified; None where it says nothing of the kind."""
    try:
        with closing(sqlite3.connect(path)) as db:
            rows, cols = db.execute("select rows, cols from map").fetchone()
            return int(rows), int(cols)
    except Exception:  # as in opening: a flipped bit shows as anything
        return None


class SqliteStore:
    """Implements `protocol.store.Store` on the file `path` for a map of `shape`; one process at a time.

    Raises StoreDamaged when the file is not whole, not ours or for another grid, StoreBusy when another process has it,
    StoreFailed when it can be neither made nor opened.
    """

    def __init__(self, path: Path, shape: tuple[int, int], timed: Timed = nullcontext) -> None:
        """`timed` makes the context in which each commit runs."""
        self._path, self._shape, self._timed = path, shape, timed
        self._total = 0
        """Sum of the checksums of all rows."""
        try:
            self._db = sqlite3.connect(path, isolation_level=None, timeout=HOLD_TIMEOUT_S)
        except sqlite3.Error as error:
            raise self._unopened(error) from error
        try:
            self._open()
            self._read_at_opening: StoredState | None = self._read()
        except StoreError:
            self._db.close()
            raise
        except (
            Exception
        ) as error:  # a flipped bit shows as anything: a text that is none, a missing column, a wrong type
            self._db.close()
            raise self._unopened(error) from error

    def _refusal(self, why: str) -> StoreDamaged:
        return StoreDamaged(self._path, why)

    def _unopened(self, error: Exception) -> StoreError:
        match _primary_code(error) if isinstance(error, sqlite3.Error) else None:
            case sqlite3.SQLITE_BUSY | sqlite3.SQLITE_LOCKED:
                return StoreBusy(f"{self._path}: another process holds it ({error}). Wait until it ends, or end it.")
            case sqlite3.SQLITE_CANTOPEN | sqlite3.SQLITE_READONLY | sqlite3.SQLITE_PERM | sqlite3.SQLITE_FULL:
                return StoreFailed(f"{self._path}: {error}. Its folder must exist, be writable and have room.")
        return self._refusal(f"it cannot be read ({error})")

    def _open(self) -> None:
        self._db.execute("pragma locking_mode = exclusive")
        for statement in ("begin exclusive", "commit"):  # holds the file from here on; undoes what was cut short
            self._db.execute(statement)
        new = self._number("select count(*) from sqlite_master") == 0
        if not new and self._number("pragma application_id") != APPLICATION_ID:
            raise self._refusal("this is not a map store")
        if not new and (found := self._number("pragma user_version")) != SCHEMA_VERSION:
            raise self._refusal(f"its schema is version {found}, this program writes {SCHEMA_VERSION}")
        self._db.execute("pragma journal_mode = truncate")
        self._db.execute("pragma synchronous = full")
        if new:
            self._create()
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
        """All that was committed, by this process too; raises StoreDamaged."""
        return self._read_at_opening or self._read()

    # --- reading -----------------------------------------------------------------------------------------------------

    def _read(self) -> StoredState:
        heads = self._db.execute("select * from map").fetchall()
        if len(heads) != 1:
            raise self._refusal("it is damaged (no head)")
        rows, cols, manager_epoch, version, checksum = heads[0]
        if (rows, cols) != self._shape:
            raise self._refusal(f"it holds a map of {rows} x {cols} cells, this scenario has {self._shape}")
        self._total = 0
        registers = self._read_registers()
        granted = tuple(Granted(robot, nonce, epoch) for robot, epoch, nonce in self._rows("hello"))
        confident = np.array(list(self._rows("confident")), CONFIDENT)
        revoked = tuple(robot for (robot,) in self._rows("revoked"))
        settled = np.array(list(self._rows("settled")), SETTLED)
        if checksum != self._head_checksum(manager_epoch, version, self._total):
            raise self._refusal("it is damaged (the sum over its rows does not match)")
        return StoredState(manager_epoch, version, registers, granted, confident, revoked, settled)

    def _rows(self, table: str) -> Iterator[tuple[Any, ...]]:
        """Rows of a table without their checksums, which are verified and summed."""
        for *row, checksum in self._db.execute(f"select * from {table}"):
            if checksum != _checksum(*row):
                raise self._refusal(f"it is damaged (a row of table {table} does not match its checksum)")
            self._total += checksum
            yield tuple(row)

    def _read_registers(self) -> dict[int, Packed]:
        blobs: dict[int, list[bytes]] = {}
        for robot, _, record in self._rows("register"):
            blobs.setdefault(robot, []).append(record)
        return {robot: np.frombuffer(b"".join(parts), REGISTER) for robot, parts in blobs.items()}

    # --- writing -----------------------------------------------------------------------------------------------------

    def commit(self, changes: Changes) -> None:
        """Keep these durably before returning; raises StoreFull (nothing kept) or StoreFailed (end the process)."""
        try:
            with self._timed():
                total = self._write(changes)
        except sqlite3.Error as error:
            if _primary_code(error) != sqlite3.SQLITE_FULL:
                raise StoreFailed(f"{self._path}: {error}") from error
            if self._db.in_transaction:
                self._db.execute("rollback")
            raise StoreFull(f"{self._path}: {error}") from error
        self._total, self._read_at_opening = total, None

    def _write(self, changes: Changes) -> int:
        """One transaction; the sum over all rows as it is then."""
        self._db.execute("begin immediate")
        total = self._total
        for robot, rows in changes.registers.items():
            total -= self._take(_TAKE_REGISTERS, robot, json.dumps(rows["cell"].tolist()))
            total += self._put(_PUT_REGISTERS, [(robot, int(row["cell"]), row.tobytes()) for row in rows])
        total += self._put(_PUT_HELLOS, [(g.robot, g.epoch, g.nonce) for g in changes.granted])
        total -= sum(self._take(_TAKE_OLD_HELLOS, robot) for robot in {g.robot for g in changes.granted})
        total -= self._take(_TAKE_CONFIDENT, json.dumps(changes.confident["cell"].tolist()))
        total += self._put(_PUT_CONFIDENT, changes.confident.tolist())
        total -= self._take(_TAKE_SETTLED, json.dumps(changes.settled["cell"].tolist()))
        total += self._put(_PUT_SETTLED, changes.settled.tolist())
        total -= sum(self._take(_TAKE_ROBOT, robot) for robot in changes.revoked)
        total += self._put(_PUT_REVOKED, [(robot,) for robot in changes.revoked])
        head = (changes.manager_epoch, changes.version)
        self._db.execute(
            "update map set manager_epoch = ?, version = ?, checksum = ?", (*head, self._head_checksum(*head, total))
        )
        self._db.execute("commit")
        return total

    def _take(self, statement: str, *arguments: int | str) -> int:
        """Delete rows; the sum of their checksums."""
        return sum(row[0] for row in self._db.execute(statement, arguments))

    def _put(self, statement: str, rows: list[Row]) -> int:
        """Insert rows; the sum of their checksums."""
        sums = [_checksum(*row) for row in rows]
        self._db.executemany(statement, ((*row, checksum) for row, checksum in zip(rows, sums, strict=True)))
        return sum(sums)
