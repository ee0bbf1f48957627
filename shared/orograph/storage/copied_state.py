"""What a Map Manager that lives has committed, read by one who only looks on: from a copy, never from its store."""

from __future__ import annotations

import shutil
import tempfile
from contextlib import closing
from pathlib import Path

from orograph.protocol.store import StoredState, StoreError
from orograph.storage.run_folder import STORE
from orograph.storage.sqlite_store import SqliteStore

TRIES = 3
"""A copy that a commit ran into is damaged, which its checksums tell; then it is made again."""


def copied_state(out: Path, shape: tuple[int, int]) -> StoredState:
    """All that the run in `out` has committed; nothing where there is no store, or no whole copy of it can be had."""
    for _ in range(TRIES):
        with tempfile.TemporaryDirectory() as folder:
            try:
                for name in (STORE, f"{STORE}-journal"):
                    if (out / name).exists():
                        shutil.copyfile(out / name, Path(folder) / name)
                if not (Path(folder) / STORE).exists():
                    return StoredState()
                with closing(SqliteStore(Path(folder) / STORE, shape)) as store:
                    return store.load()
            except (OSError, StoreError):
                continue
    return StoredState()
