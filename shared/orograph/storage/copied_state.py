"""What a Map Manager that lives has committed, read by one who only looks on: from a copy, never from its store."""

from __future__ import annotations

import shutil
import tempfile
from contextlib import closing
from pathlib import Path

from orograph.protocol.store import StoreDamaged, StoredState, StoreError
from orograph.storage.run_folder import STORE
from orograph.storage.sqlite_store import SqliteStore, said_shape

TRIES = 3
"""A copy that a commit ran into is damaged, which its checksums tell; then it is made again."""


def copied_state(out: Path, shape: tuple[int, int]) -> StoredState:
    """All that the run in `out` has committed; nothing where there is no store, or no whole copy of it can be had."""
    with tempfile.TemporaryDirectory() as folder:
        try:
            return whole_copy(out / STORE, Path(folder) / STORE, shape)
        except (OSError, StoreError):
            return StoredState()


def whole_copy(store: Path, copy: Path, shape: tuple[int, int] | None = None, tries: int = TRIES) -> StoredState:
    """Copy a store, which a manager may hold and which stays untouched, and load the copy, which then is one file.

    The manager's lock keeps SQLite's own backup out. Without `shape` it is that which the store says. More than `TRIES`
    are made only while commits go on. Raises OSError and StoreError of the last try.
    """
    tried = 0
    while True:
        before_ns, tried = store.stat().st_mtime_ns, tried + 1
        try:
            return _copied(store, copy, shape)
        except (OSError, StoreError):
            if tried >= tries or (tried >= TRIES and store.stat().st_mtime_ns == before_ns):
                raise


def _copied(store: Path, copy: Path, shape: tuple[int, int] | None) -> StoredState:
    journal, copied_journal = (path.with_name(f"{path.name}-journal") for path in (store, copy))
    copied_journal.unlink(missing_ok=True)
    shutil.copyfile(store, copy)
    if journal.exists():
        shutil.copyfile(journal, copied_journal)
    said = said_shape(copy)
    with closing(SqliteStore(copy, shape or said or (0, 0))) as opened:
        if said is None:  # else an empty file would pass for a new store
            raise StoreDamaged(copy, "it holds no map")
        return opened.load()
