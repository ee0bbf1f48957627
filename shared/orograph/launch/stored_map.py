"""The map store of a run folder, opened by a person's command while no manager holds it."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import closing, contextmanager
from dataclasses import dataclass
from pathlib import Path

from orograph.errors import InputError, RunError
from orograph.messages import Packed
from orograph.protocol.fold import whole_prior
from orograph.protocol.ledger import Ledger
from orograph.protocol.store import StoreError
from orograph.rules import Rules
from orograph.scenario import Scenario
from orograph.scene.prior import prior_records
from orograph.storage.run_folder import SCENARIO, STORE, FolderError, read_text
from orograph.storage.sqlite_store import SqliteStore


@dataclass(frozen=True, eq=False)
class StoredMap:
    """A run's scenario, the prior of every cell (UPDATE), the store, and the ledger that it makes."""

    scenario: Scenario
    prior: Packed
    store: SqliteStore
    ledger: Ledger

    @property
    def rules(self) -> Rules:
        """By which the map is folded."""
        return Rules.of(self.scenario.rules)


@contextmanager
def stored_map(out: Path) -> Iterator[StoredMap]:
    """What the run folder `out` holds; raises InputError where it holds no map, RunError where that cannot be had."""
    try:
        scenario = Scenario.model_validate_json(read_text(out, SCENARIO))
    except FolderError as error:
        raise InputError(str(error)) from None
    grid = scenario.grid.grid
    if not (out / STORE).exists():
        raise InputError(f"{out / STORE} is not there: the run has not begun, or its store was not kept")
    try:
        with closing(SqliteStore(out / STORE, grid.shape)) as store:
            prior = whole_prior(prior_records(scenario), grid.size)
            yield StoredMap(scenario, prior, store, Ledger(prior, grid.size, Rules.of(scenario.rules), store.load()))
    except StoreError as error:
        raise RunError(str(error)) from None
