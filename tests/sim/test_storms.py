"""The real nodes in seeded storms (protocol.md, "Invariants"). One seed alone: `make storms SEED=17`."""

from __future__ import annotations

from dataclasses import replace

import pytest
from simnet import glue_mutants, mutants, revocation_mutants
from simnet.checkers import violations
from simnet.plan import Plan, plan_of
from simnet.storm import ALL_REAL, Cast, Storm, run_storm

SEEDS = 300
GROUP = 20
MUTANT_SEEDS = 100


@pytest.mark.parametrize("first", range(0, SEEDS, GROUP))
def test_storm_leaves_every_invariant_whole(first):
    wrong = [f"seed {seed}: {text}" for seed in range(first, first + GROUP) for text in violations(run_storm(seed))]
    assert not wrong, "\n".join(wrong[:20])


@pytest.mark.parametrize("seed", [1, 2])
def test_in_calm_weather_the_map_is_what_the_robots_would_have_made_alone(seed):
    """All that the fault-free map of a storm is compared with, by a run in which nothing is broken."""
    storm = Storm(Plan(seed, plan_of(seed).robots), ALL_REAL)
    history = storm.run()
    assert history.fault_free_hash == history.manager_hash and history.end is not None
    assert not list(violations(history)) and history.restarts == 0 and not history.fenced
    assert not storm.network.refused and all(len(own) > 50 for own in history.own.values())


def _first_catch(mutant: type) -> int | None:
    cast = Cast.with_mutant(mutant)
    assert cast != ALL_REAL
    for seed in getattr(mutant, "seeds", range(MUTANT_SEEDS)):
        if next(violations(run_storm(seed, cast)), None):
            return seed
    return None


@pytest.mark.parametrize(
    "mutant",
    [*mutants.PROTOCOL, *glue_mutants.GLUE, *revocation_mutants.REVOCATION],
    ids=lambda mutant: mutant.__name__,
)
def test_checkers_catch_mutant(mutant):
    assert _first_catch(mutant) is not None, f"no checker saw {mutant.__name__} in {MUTANT_SEEDS} seeds"


def test_storm_repeats_by_its_seed():
    first, second = run_storm(5), run_storm(5)
    assert first.manager_hash == second.manager_hash
    assert [s.version for s in first.sightings] == [s.version for s in second.sightings]


def test_a_plan_is_cut_down_one_fault_at_a_time():
    plan = plan_of(17)
    assert plan == plan_of(17) != replace(plan_of(18), seed=17)
    faults = [plan.forecast, plan.deaths, plan.hangs, plan.full_disk, plan.failed_syncs, plan.twins]
    smaller = plan.without_one()
    assert len(smaller) == sum(map(len, faults)) + plan.meddled > 5 and len(set(smaller)) == len(smaller)
    assert Plan(17, plan.robots).without_one() == []
