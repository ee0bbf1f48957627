"""The map store of a run folder, opened by a person's command while no manager holds it."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import closing, contextmanager
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from orograph import keys
from orograph.errors import InputError, RunError
from orograph.messages import Packed
from orograph.protocol.fold import whole_prior
from orograph.protocol.ledger import Ledger
from orograph.protocol.store import Changes, StoredState, StoreError
from orograph.protocol.tiles import map_hash
from orograph.rules import Rules
from orograph.scenario import Scenario
from orograph.scene.prior import prior_records
from orograph.storage.parts import read_scenario
from orograph.storage.run_folder import STORE, node_file, read_arrays, write_arrays
from orograph.storage.sqlite_store import SqliteStore


@dataclass(frozen=True, eq=False)
class StoredMap:
    """A run's scenario, the prior of every cell (UPDATE), the store, what it holds, and the ledger of that."""

    scenario: Scenario
    prior: Packed
    store: SqliteStore
    held: StoredState
    ledger: Ledger

    @property
    def rules(self) -> Rules:
        """By which the map is folded."""
        return Rules.of(self.scenario.rules)


@contextmanager
def stored_map(out: Path) -> Iterator[StoredMap]:
    """What the run folder `out` holds; raises InputError where it holds no map, RunError where that cannot be had."""
    scenario = read_scenario(out)
    grid = scenario.grid.grid
    if not (out / STORE).exists():
        raise InputError(f"{out / STORE} is not there: the run has not begun, or its store was not kept")
    try:
        with closing(SqliteStore(out / STORE, grid.shape)) as store:
            prior = whole_prior(prior_records(scenario), grid.size)
            ledger = Ledger(prior, grid.size, Rules.of(scenario.rules), held := store.load())
            yield StoredMap(scenario, prior, store, held, ledger)
    except StoreError as error:
        raise RunError(str(error)) from None


def revoke_stored(out: Path, robot: str) -> int:
    """Revoke a robot in the store of a run folder, and in what the manager left there; how many cells changed.

    Raises InputError for a robot that is not in the run; done twice it changes nothing.
    """
    with stored_map(out) as stored:
        if robot not in stored.scenario.robot_ids:
            raise InputError(f"{robot} is not in this run of {len(stored.scenario.robot_ids)} robots")
        number, held, ledger = keys.robot_number(robot), stored.held, stored.ledger
        if number in held.revoked:
            return 0
        last_ns = int(ledger.registers()["tick"].max(initial=0)) * 1_000_000
        emptied, folded, confident = ledger.withdrawal(number, last_ns)
        version, revoked = held.version + 1, (*held.revoked, number)
        stored.store.commit(Changes(held.manager_epoch, version, confident=confident, revoked=(number,)))
        changed = ledger.apply({number: emptied}, folded, confident, version)
        _revise(out / node_file(keys.MANAGER), ledger, version, revoked)
    return len(changed)


def _revise(artifacts: Path, ledger: Ledger, version: int, revoked: tuple[int, ...]) -> None:
    """The manager's artifacts, where it left any, as of the ledger; `glrm_at_end` is what the robots have copies of."""
    if not artifacts.exists():
        return
    arrays = read_arrays(artifacts)
    arrays.setdefault("glrm_at_end", arrays["glrm"])
    write_arrays(artifacts, arrays | {
        "glrm": ledger.glrm, "registers": ledger.registers(), "first_confident_ns": ledger.first_confident_ns,
        "glrm_hash": np.frombuffer(map_hash(ledger.glrm), np.uint8), "version": np.array(version, np.int64),
        "revoked": np.array(revoked, "<u2"),
    })  # fmt: skip
