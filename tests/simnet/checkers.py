"""The invariants of protocol.md asked of a storm's history; each checker returns what it found wrong."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from itertools import pairwise

import numpy as np
from oracles.surface_oracle import fold_slowly
from orograph.judge import invariants
from simnet.history import Commit, History
from simnet.street import RULES

KEPT_SHARE = 0.75
"""Of a cell's confidence, which a new life gets back in coarse cells: there newer fine ones may replace it."""
COUNTED_SHARE = 1.5
"""For the same reason a restarted robot may be surer of a cell: what would have been replaced was not."""
HEAL_MAX_MS = 10_000
"""Promise of protocol.md; the storms cut batches and parts to a tenth, so here it is kept with less."""


def acknowledged_is_kept(history: History) -> list[str]:
    assert history.registers is not None
    acked = invariants.acknowledged((a.robot, a.epoch, a.cells, a.seqs) for a in history.acked)
    return invariants.registers_kept(acked, history.registers, revoked=history.revoked)


def registers_never_go_back(history: History) -> list[str]:
    return [
        text
        for old, new in pairwise(history.commits)
        for text in invariants.registers_kept(old.registers, new.registers, revoked=new.revoked)
    ]


def revoked_robots_are_out(history: History) -> list[str]:
    """Of the map at the end, and of every commit from the one on that revoked them."""
    assert history.registers is not None
    held = [(history.registers, history.revoked), *((c.registers, c.revoked) for c in history.commits)]
    return [text for registers, revoked in held for text in invariants.revoked_are_out(registers, revoked)]


def copies_are_equal(history: History) -> list[str]:
    if not history.quiet:
        return ["2: the run never came to rest"]
    late = invariants.within("2: from heal to quiet [ms]", history.heal_to_quiet_ms, HEAL_MAX_MS)
    return late + invariants.copies_equal(history.copy_hashes, history.manager_hash)


def registers_are_own_evidence(history: History) -> list[str]:
    assert history.registers is not None
    return invariants.registers_are_own(history.registers, history.own)


def map_is_the_fold(history: History) -> list[str]:
    """In every eighth cell, others with each seed: the slow fold takes its time."""
    assert history.glrm is not None and history.registers is not None
    some = history.prior["cell"] % 8 == history.seed % 8
    registers = history.registers[some[history.registers["cell"]]]
    return invariants.map_is_fold(history.glrm[some], fold_slowly(history.prior[some], registers, RULES))


def versions_never_go_back(history: History) -> list[str]:
    return invariants.versions_grow((s.robot, s.manager_epoch, s.version) for s in history.sightings)


def copies_hold_committed_values(history: History) -> list[str]:
    if not history.commits:
        return []
    maps = np.stack([commit.glrm for commit in history.commits])
    versions = np.array([commit.version for commit in history.commits])
    wrong = []
    for seen in history.sightings:
        begin = np.searchsorted(versions, seen.version, side="left")
        wrong += invariants.copy_was_committed(seen.robot, seen.version, seen.cells, maps[begin : seen.commits])
    return wrong


def queues_are_bounded(history: History) -> list[str]:
    loads = history.loads.items()
    return [
        text
        for robot, load in loads
        for text in invariants.uplink_bounded(robot, len(history.prior), load.waiting, load.flights, load.batch_records)
    ]


def recovery_is_repeatable(history: History) -> list[str]:
    return [text for once, twice in history.recovered for text in invariants.recovery_repeats(once, twice)]


def rejected_changes_nothing(history: History) -> list[str]:
    return invariants.within("8: rejected inputs with an effect", history.rejected_changes, 0)


def fencings_are_explained(history: History) -> list[str]:
    """Of two with one id the fenced one comes back where the other's acks are lost for long: a conflict once more."""
    forgotten = history.lost_disks * len(history.copy_hashes)  # nonces that may come again, late, as new ones
    conflicts = history.conflicts + history.returns + forgotten
    return invariants.fencings_explained(len(history.fenced), conflicts, history.restarts)


def confidence_survives_restart(history: History) -> list[str]:
    """What a robot says of a cell in a new epoch is hardly less sure than what it said before.

    Of two with one id the one that comes back puts its own over what the other has said.
    """
    if history.returns:
        return []
    return [
        text
        for before, now in pairwise(map(_confidence, history.commits))
        for text in invariants.confidence_kept(
            ((*key, sure, now[key][1]) for key, (epoch, sure) in before.items() if now.get(key, (0,))[0] > epoch),
            KEPT_SHARE,
            1,
        )
    ]


def _confidence(commit: Commit) -> dict[tuple[int, int], tuple[int, int]]:
    rows = commit.registers
    keys = zip(rows["robot"].tolist(), rows["cell"].tolist(), strict=True)
    return dict(zip(keys, zip(rows["epoch"].tolist(), rows["confidence"].tolist(), strict=True), strict=True))


def evidence_is_counted_once(history: History) -> list[str]:
    """No register is much surer than its robot would be had it seen all scans in one undisturbed life.

    Two containers with one id map the same scans, and each is a life of its own.
    """
    wrong: list[str] = []
    if history.conflicts:
        return wrong
    for robot, own in history.own.items():
        most = dict(
            zip(history.alone[robot]["cell"].tolist(), history.alone[robot]["confidence"].tolist(), strict=True)
        )
        for cell, sure in zip(own["cell"].tolist(), own["confidence"].tolist(), strict=True):
            wrong += invariants.within(
                f"3: confidence of robot {robot} in cell {cell}", sure, COUNTED_SHARE * most.get(cell, 0) + 1
            )
    return wrong


def the_end_is_true(history: History) -> list[str]:
    """2: the mission is declared over when all is quiet, and with equal copies."""
    if history.conflicts:
        return []
    if history.end is None:
        return ["2: the orchestrator never ended the run"]
    early = [] if history.rests_at_end else ["2: the orchestrator ended the run before all was quiet"]
    return early if history.end.complete and history.end.copies_equal else [*early, f"2: it ended with {history.end}"]


def map_is_that_of_a_fault_free_run(history: History) -> list[str]:
    expected = history.fault_free_hash
    return [] if expected is None else invariants.map_is_fault_free(history.manager_hash, expected)


CHECKERS: tuple[Callable[[History], list[str]], ...] = (
    acknowledged_is_kept, registers_never_go_back, revoked_robots_are_out, copies_are_equal,
    registers_are_own_evidence, map_is_the_fold, versions_never_go_back, copies_hold_committed_values,
    queues_are_bounded, recovery_is_repeatable, rejected_changes_nothing, fencings_are_explained,
    confidence_survives_restart, evidence_is_counted_once, the_end_is_true, map_is_that_of_a_fault_free_run,
)  # fmt: skip


def violations(history: History) -> Iterator[str]:
    """What the checkers find wrong, one after the other."""
    for checker in CHECKERS:
        yield from checker(history)
