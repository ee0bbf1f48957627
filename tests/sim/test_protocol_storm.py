"""The protocol objects in seeded storms (protocol.md, "Invariants"). One seed alone: `ORO_SEED=17 pytest tests/sim`."""

from __future__ import annotations

import os

import pytest
from orograph.protocol.manager import ManagerSync
from orograph.protocol.robot import RobotSync
from simnet import mutants
from simnet.checkers import violations
from simnet.storm import run_storm

SEEDS = 300
GROUP = 20
MUTANT_SEEDS = 100
HEAL_MAX_MS = 10_000
"""Promise of protocol.md; the storms cut batches and parts to a tenth, so here it is kept with less."""


def _wrong(seed: int) -> list[str]:
    history = run_storm(seed)
    found = [f"seed {seed}: {text}" for text in violations(history)]
    slow = history.heal_to_quiet_ms > HEAL_MAX_MS
    return [*found, *([f"seed {seed}: quiet only after {history.heal_to_quiet_ms} ms"] if slow else [])]


def _groups() -> list[list[int]]:
    if "ORO_SEED" in os.environ:
        return [[int(os.environ["ORO_SEED"])]]
    return [list(range(first, first + GROUP)) for first in range(0, SEEDS, GROUP)]


@pytest.mark.parametrize("seeds", _groups(), ids=lambda seeds: f"{seeds[0]}-{seeds[-1]}")
def test_storm_leaves_every_invariant_whole(seeds):
    wrong = [text for seed in seeds for text in _wrong(seed)]
    assert not wrong, "\n".join(wrong[:20])


def _first_catch(mutant: type) -> int | None:
    side = "manager_class" if issubclass(mutant, ManagerSync) else "robot_class"
    assert issubclass(mutant, ManagerSync | RobotSync)
    for seed in getattr(mutant, "seeds", range(MUTANT_SEEDS)):
        if next(violations(run_storm(seed, compare=False, **{side: mutant})), None):
            return seed
    return None


@pytest.mark.parametrize("mutant", [*mutants.MANAGERS, *mutants.ROBOTS], ids=lambda mutant: mutant.__name__)
def test_checkers_catch_mutant(mutant):
    assert _first_catch(mutant) is not None, f"no checker saw {mutant.__name__} in {MUTANT_SEEDS} seeds"


def test_storm_repeats_by_its_seed():
    first, second = run_storm(5), run_storm(5)
    assert first.manager_hash == second.manager_hash
    assert [s.version for s in first.sightings] == [s.version for s in second.sightings]
