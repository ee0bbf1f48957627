"""The invariants of protocol.md asked of a storm's history; each checker returns what it found wrong."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from itertools import pairwise

import numpy as np
from oracles.fold_oracle import fold_slowly
from orograph.judge import invariants
from simnet.history import Commit, History


def acknowledged_is_kept(history: History) -> list[str]:
    assert history.registers is not None
    acked = invariants.acknowledged((a.robot, a.epoch, a.cells, a.seqs) for a in history.acked)
    return invariants.registers_kept(acked, history.registers)


def registers_never_go_back(history: History) -> list[str]:
    commits = pairwise(history.commits)
    return [text for old, new in commits for text in invariants.registers_kept(old.registers, new.registers)]


def copies_are_equal(history: History) -> list[str]:
    quiet = [] if history.quiet else ["2: the run never came to rest"]
    return quiet or invariants.copies_equal(history.copy_hashes, history.manager_hash)


def registers_are_own_evidence(history: History) -> list[str]:
    assert history.registers is not None
    return invariants.registers_are_own(history.registers, history.own)


def map_is_the_fold(history: History) -> list[str]:
    assert history.prior is not None and history.glrm is not None and history.registers is not None
    return invariants.map_is_fold(history.glrm, fold_slowly(history.prior, history.registers))


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
        for text in invariants.uplink_bounded(robot, history.size, load.waiting, load.flights, load.batch_records)
    ]


def recovery_is_repeatable(history: History) -> list[str]:
    return [text for once, twice in history.recovered for text in invariants.recovery_repeats(once, twice)]


def rejected_changes_nothing(history: History) -> list[str]:
    return invariants.within("8: rejected inputs with an effect", history.rejected_changes, 0)


def fencings_are_explained(history: History) -> list[str]:
    forgotten = history.lost_disks * len(history.copy_hashes)  # nonces that may come again, late, as new ones
    return invariants.fencings_explained(len(history.fenced), history.conflicts + forgotten, history.restarts)


def confidence_survives_restart(history: History) -> list[str]:
    """Never less at all: the miniature mapper forgets nothing by itself."""
    return [
        text
        for before, now in pairwise(map(_confidence, history.commits))
        for text in invariants.confidence_kept((*key, sure, now.get(key, 0)) for key, sure in before.items())
    ]


def _confidence(commit: Commit) -> dict[tuple[int, int], int]:
    rows = zip(*(commit.registers[name].tolist() for name in ("robot", "cell", "confidence")), strict=True)
    return {(robot, cell): confidence for robot, cell, confidence in rows}


def map_is_that_of_a_fault_free_run(history: History) -> list[str]:
    expected = history.fault_free_hash
    return [] if expected is None else invariants.map_is_fault_free(history.manager_hash, expected)


CHECKERS: tuple[Callable[[History], list[str]], ...] = (
    acknowledged_is_kept, registers_never_go_back, copies_are_equal, registers_are_own_evidence, map_is_the_fold,
    versions_never_go_back, copies_hold_committed_values, queues_are_bounded, recovery_is_repeatable,
    rejected_changes_nothing, fencings_are_explained, confidence_survives_restart, map_is_that_of_a_fault_free_run,
)  # fmt: skip


def violations(history: History) -> Iterator[str]:
    """What the checkers find wrong, one after the other."""
    for checker in CHECKERS:
        yield from checker(history)
