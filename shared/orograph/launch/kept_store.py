"""The map store of a run as a person keeps it: looked through, copied away, put back; a manager may hold it meanwhile.

A store is only ever judged, and backed up, by a copy of it; `restore` alone takes the place's own file, and its lock.
"""

from __future__ import annotations

import os
import shutil
import tempfile
from collections.abc import Iterator
from contextlib import ExitStack, closing, contextmanager
from dataclasses import dataclass
from pathlib import Path

from orograph import keys
from orograph.errors import InputError, RunError
from orograph.protocol.fold import whole_prior
from orograph.protocol.ledger import Ledger
from orograph.protocol.store import StoreDamaged, StoredState, StoreError
from orograph.protocol.tiles import map_hash
from orograph.rules import Rules
from orograph.scenario import Scenario
from orograph.scene.prior import prior_records
from orograph.storage.copied_state import whole_copy
from orograph.storage.parts import read_scenario
from orograph.storage.run_folder import SCENARIO, STORE, whole_file
from orograph.storage.sqlite_store import SqliteStore

CURE = (
    "It is left as it is: put a backup in its place (orograph store restore FILE --to DIR), or move it away and start "
    "with an empty map, which robots that live fill again"
)
NO_CURE = "Nothing was restored: take another backup"
LIVE_TRIES = 12
"""Of copying a store in which commits go on: without a pause between them every sixth copy of 9 MB was torn."""


@dataclass(frozen=True, eq=False)
class Kept:
    """A store that is whole, what it holds, and its run's scenario, None of a file by itself."""

    path: Path
    held: StoredState
    scenario: Scenario | None

    def map_hash(self) -> str | None:
        """The global map's hash in hex; None where the scenario is not at hand: the map begins with its prior."""
        if self.scenario is None:
            return None
        size = self.scenario.grid.grid.size
        prior = whole_prior(prior_records(self.scenario), size)
        return map_hash(Ledger(prior, size, Rules.of(self.scenario.rules), self.held).glrm).hex()


def check(place: Path) -> Kept:
    """The store of a run folder or a file; raises InputError where there is none, RunError where it is not whole."""
    with _copy_of(place) as (_, kept):
        return kept


def back_up(place: Path, to: Path) -> Kept:
    """Write a whole copy of a store to the new file `to`; raises InputError and RunError, and then leaves none."""
    if to.exists():
        raise InputError(f"--to {to}: it is there already, and no backup is written over; name a new file")
    with _copy_of(place) as (copy, kept):
        _put(copy, to)
    return kept


@dataclass(frozen=True, eq=False)
class Restored:
    """What was put back, what that cost, and where the damaged store went that was in its place."""

    kept: Kept
    lost: tuple[str, ...]
    moved_to: Path | None


def restore(file: Path, out: Path, force: bool) -> Restored:
    """Put a backup into a run folder; raises InputError where that loses anything and is not forced, RunError.

    A store that is damaged is moved aside, and one that a manager holds is left alone.
    """
    scenario, store = read_scenario(out), out / STORE
    with _copy_of(file, scenario, NO_CURE) as (copy, kept), _locked(store, scenario.grid.grid.shape) as there:
        lost = () if there is None else tuple(_lost(there, kept.held))
        if lost and not force:
            raise InputError(f"{store} holds what {file} does not: {', '.join(lost)}. Keep it first (orograph store "
                             f"backup {out} --to NEW), then say --force")  # fmt: skip
        moved_to = _moved_aside(store) if there is None else None
        _put(copy, store)
    return Restored(kept, lost, moved_to)


@contextmanager
def _locked(store: Path, shape: tuple[int, int]) -> Iterator[StoredState | None]:
    """What a store holds, kept from any manager meanwhile; None where there is none, or none that is whole."""
    with ExitStack() as locks:
        there = None
        if store.exists():
            try:
                there = locks.enter_context(closing(SqliteStore(store, shape))).load()
            except StoreDamaged:
                pass
            except StoreError as error:
                raise RunError(str(error)) from None
        yield there


@contextmanager
def _copy_of(place: Path, scenario: Scenario | None = None, cure: str = CURE) -> Iterator[tuple[Path, Kept]]:
    """A whole copy of the store of a run folder, or of a file, in a folder that goes away."""
    path = place / STORE if place.is_dir() else place
    if not path.is_file():
        raise InputError(f"{path} is not there: name a run folder with a store, or a store's file")
    if scenario is None and path.name == STORE and (path.parent / SCENARIO).exists():
        scenario = read_scenario(path.parent)
    with tempfile.TemporaryDirectory() as folder:
        copy = Path(folder) / STORE
        try:
            held = whole_copy(path, copy, scenario.grid.grid.shape if scenario else None, LIVE_TRIES)
        except OSError as error:
            raise InputError(f"{path}: cannot be copied to {folder} ({error.strerror})") from None
        except StoreError as error:
            why = error.why if isinstance(error, StoreDamaged) else f"it cannot be read ({error.__cause__})"
            raise RunError(f"{path}: {' '.join(why.split())}. {cure}") from None
        yield copy, Kept(path, held, scenario)


def _put(copy: Path, to: Path) -> None:
    """Write a copy to its place, synced and read again before it bears its name."""
    try:
        with whole_file(to) as stream:
            with copy.open("rb") as source:
                shutil.copyfileobj(source, stream)
            stream.flush()
            os.fsync(stream.fileno())
            with _copy_of(Path(stream.name)):
                pass
    except OSError as error:
        raise InputError(f"{to}: cannot be written ({error.strerror})") from None


def _moved_aside(store: Path) -> Path | None:
    """Give a store that is not whole another name; None where there is none.

    What is left of its journal goes first, else it would be played back into the store that takes its place.
    """
    names = (store.with_name(f"{store.name}.damaged-{i:03d}") for i in range(1, 1000))
    aside = next(path for path in names if not list(path.parent.glob(f"{path.name}*")))
    for end in ("-journal", ""):
        if (left := store.with_name(store.name + end)).exists():
            left.rename(aside.with_name(aside.name + end))
    return aside if aside.exists() else None


def _lost(there: StoredState, back: StoredState) -> Iterator[str]:
    """What a store holds and an older one, put in its place, does not."""
    if there.version > back.version:
        first, last = back.version + 1, there.version
        yield f"version {last}" if first == last else f"versions {first} to {last}"
    newer = 0
    for robot in there.registers.keys() - set(back.revoked):
        theirs = {row["cell"]: (row["epoch"], row["seq"]) for row in back.registers.get(robot, ())}
        newer += sum((row["epoch"], row["seq"]) > theirs.get(row["cell"], (0, 0)) for row in there.registers[robot])
    if newer:
        yield f"{newer} newer registers"
    for robot in sorted(set(there.revoked) - set(back.revoked)):
        yield f"the revocation of {keys.robot_id(robot)}"
