"""The invariants of protocol.md as pure functions over recorded evidence; report, storms and chaos suite call them.

Each gives what it found wrong, a line per fault that begins with the invariant's number; nothing wrong, an empty list.
What a caller compares with (a slow fold, a run without faults) is the caller's, so that nothing judges itself.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping, Sequence
from itertools import pairwise

import numpy as np
import numpy.typing as npt

from orograph.arrays import I64, Mask
from orograph.layers import MAPPED_LAYERS
from orograph.messages import Packed
from orograph.protocol.fold import same_values

IN_FLIGHT_MAX, BATCH_MAX = 4, 256
"""Bounds of a robot's uplink (protocol.md, "Bounds"): batches without an answer, records in each."""

ACKNOWLEDGED = np.dtype([("robot", "<u2"), ("cell", "<u4"), ("epoch", "<u4"), ("seq", "<u4")])


def acknowledged(acks: Iterable[tuple[int, int, npt.ArrayLike, npt.ArrayLike]]) -> Packed:
    """ACKNOWLEDGED records (n,) of what was said in (robot, epoch, its cells (k,), their seqs (k,))."""
    parts = [np.zeros(0, ACKNOWLEDGED)]
    for robot, epoch, cells, seqs in acks:
        part = np.zeros(np.size(cells), ACKNOWLEDGED)
        part["robot"], part["epoch"], part["cell"], part["seq"] = robot, epoch, cells, seqs
        parts.append(part)
    return np.concatenate(parts)


def registers_kept(
    acked: Packed, held: Packed, by: Sequence[str] = ("epoch", "seq"), revoked: Collection[int] = ()
) -> list[str]:
    """1: of the registers (n,) with fields robot, cell and `by`, none is missing or older by those among `held` (m,).

    Those of robots (by number) that were `revoked` are no losses. Between the registers of two commits the same says
    that none went back.
    """
    acked = acked[~np.isin(acked["robot"], list(revoked))]
    found, known = _partners(acked, held)
    lost = ~known
    lost[known] = _rank(held[found[known]], by) < _rank(acked[known], by)
    return [
        f"1: robot {row['robot']} cell {row['cell']} was acknowledged as {_told(row, by)}, held is "
        f"{_told(held[at], by) if there else 'nothing'}"
        for row, at, there in zip(acked[lost], found[lost], known[lost], strict=True)
    ]


def revoked_are_out(held: Packed, revoked: Collection[int]) -> list[str]:
    """13: of robots (by number) that were revoked there is nothing among the registers (n,) held."""
    return [
        f"13: robot {robot} was revoked, {n} registers of it are held"
        for robot in revoked
        if (n := int((held["robot"] == robot).sum()))
    ]


def copies_equal(copies: Mapping[str, bytes], manager: bytes) -> list[str]:
    """2: every robot's copy has the manager's hash."""
    return [f"2: {robot}'s copy differs" for robot, found in copies.items() if found != manager]


def registers_are_own(
    held: Packed, own: Mapping[int, Packed], fields: Sequence[str] = ("cell", "tick", *MAPPED_LAYERS)
) -> list[str]:
    """3: each robot's registers among ROBOT_REGISTERs (n,) are its mapper's evidence, robot -> UPDATEs by cell."""
    wrong = []
    for robot, mine in own.items():
        row = held[held["robot"] == robot]
        row = row[np.argsort(row["cell"], kind="stable")]
        if len(row) != len(mine) or any(not np.array_equal(row[name], mine[name]) for name in fields):
            wrong.append(f"3: robot {robot}'s registers ({len(row)}) are not its own evidence ({len(mine)})")
    return wrong


def map_is_fold(glrm: Packed, fold: Packed) -> list[str]:
    """3: the manager's map (n,) is what its registers fold to (n,), in all values of every cell."""
    return [
        f"3: cell {cell} is {_told(glrm[cell], MAPPED_LAYERS)}, "
        f"its registers fold to {_told(fold[cell], MAPPED_LAYERS)}"
        for cell in np.flatnonzero(~same_values(glrm, fold))
    ]


def versions_grow(seen: Iterable[tuple[str, int, int]], falls_allowed: Mapping[str, int] | None = None) -> list[str]:
    """4: of (who, manager epoch, version) in order of time, neither the epoch nor the version within it falls.

    Where the epoch was not recorded, give 0 and who may fall how often because a new life began.
    """
    newest: dict[str, tuple[int, int]] = {}
    falls: dict[str, list[str]] = {}
    for who, epoch, version in seen:
        before, now = newest.get(who, (0, 0)), (epoch, version)
        if now < before:
            falls.setdefault(who, []).append(f"4: {who}'s copy went from {before} to {now}")
        newest[who] = now
    allowed = falls_allowed or {}
    return [text for who, found in falls.items() if len(found) > allowed.get(who, 0) for text in found]


def published_is_kept(published: Iterable[tuple[int, int, str | None]]) -> list[str]:
    """4: of (manager epoch, version, hash of the map or None), what one life published the next still has.

    A version is one map only.
    """
    lives: dict[int, list[int]] = {}
    maps: dict[int, set[str]] = {}
    for epoch, version, hashed in published:
        lives.setdefault(epoch, []).append(version)
        if hashed is not None:
            maps.setdefault(version, set()).add(hashed)
    wrong = [
        f"4: life {now} of the manager knows version {min(lives[now])}, life {before} published {max(lives[before])}"
        for before, now in pairwise(sorted(lives))
        if min(lives[now]) < max(lives[before])
    ]
    return wrong + [f"4: version {v} was {len(hashes)} different maps" for v, hashes in maps.items() if len(hashes) > 1]


def copy_was_committed(who: str, version: int, copy: Packed, since: Packed) -> list[str]:
    """4, 6: a copy (n,) holds in every cell a value of the maps (k, n) committed at its version or later.

    So there is no gap, and nothing else was ever visible.
    """
    same = np.ones(since.shape, np.bool_)
    for name in MAPPED_LAYERS:
        same &= since[name] == copy[name]
    cells = np.flatnonzero(~same.any(axis=0))
    return [f"4/6: {who} at version {version} holds what was never committed since: {cells[:5]}"] if cells.size else []


def uplink_bounded(robot: str, cells: int, waiting: int, in_flight: int, batch: int) -> list[str]:
    """5: one record per cell waits, few batches are under way, a batch is small."""
    return [
        *within(f"5: cells that wait at {robot}", waiting, cells),
        *within(f"5: batches of {robot} in flight", in_flight, IN_FLIGHT_MAX),
        *within(f"5: records in a batch of {robot}", batch, BATCH_MAX),
    ]


def recovery_repeats(once: bytes, twice: bytes) -> list[str]:
    """7: recovering the same store twice gives the same hash; so does what the manager had in memory."""
    return [] if once == twice else ["7: a recovery gave another map"]


def fencings_explained(fencings: int, conflicts: int, restarts: int) -> list[str]:
    """9: no more fencings than identity conflicts and restarts."""
    return within("9: fencings", fencings, conflicts + restarts)


def confidence_kept(changes: Iterable[tuple[int, int, int, int]], share: float = 1.0, rounding: int = 0) -> list[str]:
    """10: of (robot, cell, confidence before, confidence now) no robot's own confidence in a cell fell.

    But by the share that may go where a robot is told its own row in coarse cells.
    """
    return [
        f"10: robot {robot}'s confidence in cell {cell} fell from {before} to {now}"
        for robot, cell, before, now in changes
        if now < share * before - rounding
    ]


def map_is_fault_free(found: bytes, fault_free: bytes) -> list[str]:
    """11: the map is bit for bit that of a run without faults over the same scans."""
    return [] if found == fault_free else ["11: the map differs from the fault-free run's"]


def within(what: str, found: float, most: float) -> list[str]:
    """Any invariant that is a bound: `what` begins with its number (5, 8: refusals, 9, 12: latency)."""
    return [f"{what}: {found:g}, at most {most:g}"] if found > most else []


def _partners(wanted: Packed, among: Packed) -> tuple[I64, Mask]:
    """Where each wanted (robot, cell) stands among the others (m,), each there at most once, and whether it does."""
    keys = _rank(among, ("robot", "cell"))
    if not len(among):
        return np.zeros(len(wanted), np.int64), np.zeros(len(wanted), np.bool_)
    order = np.argsort(keys, kind="stable")
    asked = _rank(wanted, ("robot", "cell"))
    at = order[np.minimum(np.searchsorted(keys[order], asked), len(among) - 1)]
    return at, keys[at] == asked


def _rank(rows: Packed, by: Sequence[str]) -> npt.NDArray[np.uint64]:
    """The order of rows by at most two unsigned fields of 32 bits, the first before the second."""
    rank = np.zeros(len(rows), np.uint64)
    for name in by:
        rank = rank << np.uint64(32) | rows[name].astype(np.uint64)
    return rank


def _told(row: np.void, fields: Sequence[str]) -> tuple[int, ...]:
    return tuple(int(row[name]) for name in fields)
