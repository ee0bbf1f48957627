"""MUTANT: a Map Manager that acknowledges before it commits; its disk hears of it many commits later.

Only for the proof that the chaos checkers see; mounted into the container by an overlay, never in the product.
"""

from __future__ import annotations

import runpy

from orograph.protocol.store import Changes
from orograph.storage import sqlite_store as store

LATE = 25
"""Commits that are held back."""


class LateStore(store.SqliteStore):
    """Says that it has kept what it will keep later."""

    _held_back: list[Changes]

    def commit(self, changes: Changes) -> None:
        """Keep it later."""
        self.__dict__.setdefault("_held_back", []).append(changes)
        if len(self._held_back) > LATE:
            for late in self._held_back:
                super().commit(late)
            self._held_back.clear()


if __name__ == "__main__":
    store.SqliteStore = LateStore  # type: ignore[misc]
    runpy.run_module("services.map_manager", run_name="__main__")
