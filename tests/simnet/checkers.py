"""The invariants of protocol.md, judged from a history alone; each checker returns what it found wrong."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np
from oracles.fold_oracle import fold_cell
from orograph.messages import UPDATE
from orograph.protocol.fold import VALUES
from simnet.history import Commit, History

IN_FLIGHT_MAX = 4
BATCH_MAX = 256


def _held(commit_registers: np.ndarray) -> dict[tuple[int, int], tuple[int, int]]:
    rows = zip(*(commit_registers[name].tolist() for name in ("robot", "cell", "epoch", "seq")), strict=True)
    return {(robot, cell): (epoch, seq) for robot, cell, epoch, seq in rows}


def acknowledged_is_kept(history: History) -> list[str]:
    """1: no acknowledged (robot, cell, epoch, seq) is missing or older at the end."""
    assert history.registers is not None
    held, wrong = _held(history.registers), []
    for ack in history.acked:
        for cell, seq in zip(ack.cells.tolist(), ack.seqs.tolist(), strict=True):
            found = held.get((ack.robot, cell), (0, 0))
            if found < (ack.epoch, seq):
                wrong.append(f"1: acked robot {ack.robot} cell {cell} {(ack.epoch, seq)}, held {found}")
    return wrong


def registers_never_go_back(history: History) -> list[str]:
    """1: from commit to commit (epoch, seq) of a register only grows."""
    wrong: list[str] = []
    before: dict[tuple[int, int], tuple[int, int]] = {}
    for commit in history.commits:
        now = _held(commit.registers)
        wrong += [
            f"1: register {key} went from {at} to {now.get(key)}"
            for key, at in before.items()
            if now.get(key, (0, 0)) < at
        ]
        before = now
    return wrong


def copies_are_equal(history: History) -> list[str]:
    """2: after heal and quiet every copy has the manager's hash."""
    if not history.quiet:
        return ["2: the run never came to rest"]
    return [
        f"2: {robot}'s copy differs" for robot, found in history.copy_hashes.items() if found != history.manager_hash
    ]


def registers_are_own_evidence(history: History) -> list[str]:
    """3: each register equals the robot's last own value, and there is no other."""
    assert history.registers is not None
    wrong = []
    for robot, own in history.own.items():
        held = history.registers[history.registers["robot"] == robot]
        names = [name for name in UPDATE.names or () if name != "seq"]
        same = len(held) == len(own) and all(np.array_equal(held[name], own[name]) for name in names)
        if not same:
            wrong.append(f"3: robot {robot}'s registers ({len(held)}) are not its own evidence ({len(own)})")
    return wrong


def map_is_the_fold(history: History) -> list[str]:
    """3: the manager's map equals a slow reference fold of its registers."""
    assert history.prior is not None and history.glrm is not None and history.registers is not None
    by_cell: dict[int, list[np.void]] = {}
    for register in history.registers:
        by_cell.setdefault(int(register["cell"]), []).append(register)
    wrong = []
    for cell in range(history.size):
        expected = fold_cell(history.prior[cell], by_cell.get(cell, []))
        found = tuple(int(history.glrm[name][cell]) for name in VALUES)
        if found != expected:
            wrong.append(f"3: cell {cell} is {found}, its registers fold to {expected}")
    return wrong


def versions_never_go_back(history: History) -> list[str]:
    """4: within a manager epoch a robot's version only grows, and the manager epoch never falls."""
    wrong: list[str] = []
    seen: dict[str, tuple[int, int]] = {}
    for sighting in history.sightings:
        now, before = (sighting.manager_epoch, sighting.version), seen.get(sighting.robot, (0, 0))
        if now < before:
            wrong.append(f"4: {sighting.robot}'s copy went from {before} to {now}")
        seen[sighting.robot] = now
    return wrong


def _values(commit: Commit) -> np.ndarray:
    return np.stack([commit.glrm[name].astype(np.int64) for name in VALUES])


def copies_hold_committed_values(history: History) -> list[str]:
    """4, 6: a copy at version v holds in every cell a value committed at v or later: no gap, nothing else."""
    if not history.commits:
        return []
    values = np.stack([_values(commit) for commit in history.commits])
    versions = np.array([commit.version for commit in history.commits])
    wrong = []
    for sighting in history.sightings:
        copy = np.stack([sighting.cells[name].astype(np.int64) for name in VALUES])
        begin = np.searchsorted(versions, sighting.version, side="left")
        allowed = values[begin : sighting.commits]
        found = (allowed == copy).all(axis=1).any(axis=0)
        if not found.all():
            cells = np.flatnonzero(~found)[:5].tolist()
            wrong.append(
                f"4/6: {sighting.robot} at version {sighting.version} holds what was never committed since: {cells}"
            )
    return wrong


def queues_are_bounded(history: History) -> list[str]:
    """5: one record per cell in the outbox, 4 batches in flight, 256 records a batch."""
    wrong = []
    for robot, load in history.loads.items():
        if load.waiting > history.size or load.flights > IN_FLIGHT_MAX or load.batch_records > BATCH_MAX:
            wrong.append(f"5: {robot} exceeded its bounds: {load}")
    return wrong


def recovery_is_repeatable(history: History) -> list[str]:
    """7: recovering the same store twice gives the same map."""
    return [f"7: recovery {i} differs" for i, (once, twice) in enumerate(history.recovered) if once != twice]


def rejected_changes_nothing(history: History) -> list[str]:
    """8: every rejected input is counted and changes no state."""
    return [f"8: {history.rejected_changes} rejected inputs had an effect"] if history.rejected_changes else []


def fencings_are_explained(history: History) -> list[str]:
    """9: no more fencings than identity conflicts and restarts."""
    allowed = history.conflicts + history.restarts
    return [f"9: {len(history.fenced)} fencings, {allowed} causes"] if len(history.fenced) > allowed else []


def confidence_survives_restart(history: History) -> list[str]:
    """10: a robot's own confidence in a cell never falls (the miniature mapper forgets nothing by itself)."""
    wrong = []
    before: dict[tuple[int, int], int] = {}
    for commit in history.commits:
        rows = zip(*(commit.registers[name].tolist() for name in ("robot", "cell", "confidence")), strict=True)
        now = {(robot, cell): confidence for robot, cell, confidence in rows}
        fell = [key for key, confidence in before.items() if now.get(key, 0) < confidence]
        wrong += [f"10: confidence of robot, cell {key} fell from {before[key]} to {now.get(key, 0)}" for key in fell]
        before = now
    return wrong


def map_is_that_of_a_fault_free_run(history: History) -> list[str]:
    """11: where no robot lost its memory, the map is bit for bit that of a run without faults."""
    if history.fault_free_hash in (None, history.manager_hash):
        return []
    return ["11: the map differs from the fault-free run's"]


CHECKERS: tuple[Callable[[History], list[str]], ...] = (
    acknowledged_is_kept, registers_never_go_back, copies_are_equal, registers_are_own_evidence, map_is_the_fold,
    versions_never_go_back, copies_hold_committed_values, queues_are_bounded, recovery_is_repeatable,
    rejected_changes_nothing, fencings_are_explained, confidence_survives_restart, map_is_that_of_a_fault_free_run,
)  # fmt: skip


def violations(history: History) -> Iterator[str]:
    """What the checkers find wrong, one after the other."""
    for checker in CHECKERS:
        yield from checker(history)
