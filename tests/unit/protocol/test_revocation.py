"""A robot is revoked: the map without it, for good, whatever is sent, repeated or killed."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from made_up.cells import flat_prior
from orograph.messages import UPDATE, Ack, Batch, CellsRequest, Delta, Hello, Welcome
from orograph.protocol.fold import fold_registers
from orograph.protocol.manager import ManagerSync
from orograph.protocol.store import MemoryStore, StoreFailed
from orograph.protocol.tiles import map_hash
from orograph.rules import SURFACE

SHAPE, SIZE = (4, 5), 20
A, B = "robot_001", "robot_002"


def records(cells, seq=1, height=100, tick=0, confidence=50) -> np.ndarray:
    out = np.zeros(len(cells), UPDATE)
    out["cell"], out["height"], out["tick"], out["confidence"], out["seq"] = cells, height, tick, confidence, seq
    return out


class Played:
    """A manager over a store, welcomed robots A and B, and what it sent and noted."""

    def __init__(self) -> None:
        self.store, self.now_ns, self.sent, self.notes = MemoryStore(), 0, [], []
        self.restart()
        self.step((A, Hello(b"a" * 16)), (B, Hello(b"b" * 16)))
        self.step((A, Batch(1, records([1, 2], confidence=200))), (B, Batch(1, records([2, 3], height=140))))
        self.step(seconds=1)
        self.sent.clear()

    def restart(self) -> None:
        self.sync = ManagerSync(SHAPE, flat_prior(SIZE), SURFACE, self.store, [A, B])

    def step(self, *inbox, seconds=0.6) -> None:
        self.now_ns += round(seconds * 1e9)
        note = lambda kind, fields: self.notes.append((kind, fields))  # noqa: E731
        self.sync.step(self.now_ns, inbox, lambda to, m: self.sent.append((to, m)), note)

    def took(self, kind) -> list:
        return [m for _, m in self.sent if isinstance(m, kind)]


@pytest.fixture
def played() -> Played:
    return Played()


def test_the_map_is_the_one_without_it_and_the_change_goes_out_as_any_other(played) -> None:
    registers, version, commits = played.sync.registers(), played.sync.version, played.store.commits
    played.sync.revoke(A)
    played.step()
    without = fold_registers(flat_prior(SIZE), registers[registers["robot"] == 2], SURFACE)
    assert played.sync.hash() == map_hash(without) and played.sync.revoked == (A,)
    assert played.store.commits == commits + 1 and played.sync.version == version + 1
    (beat,) = played.took(Delta)
    assert beat.cells["cell"].tolist() == [1, 2] and (beat.first_version, beat.last_version) == (version, version + 1)
    assert played.notes[-1] == ("revoked", {"robot": A, "registers": 2, "cells_changed": 2})
    assert played.sync.first_confident_ns.tolist() == [-1] * SIZE and played.sync.confident_cells == 0


@pytest.mark.parametrize("restarts", [False, True], ids=["same life", "after a restart"])
def test_nothing_of_it_is_taken_again(played, restarts) -> None:
    played.sync.revoke(A)
    played.step()
    if restarts:
        played.restart()
    found, commits = played.sync.hash(), played.store.commits + restarts
    old = (A, Batch(1, records([1, 2], confidence=200)))
    hello, later = (A, Hello(b"n" * 16)), (A, Batch(2, records([1], seq=9)))
    for message in (old, hello, later, (A, Hello(b"a" * 16)), (A, CellsRequest(0, 0, np.zeros(0, "<u2")))):
        played.step(message)
    assert played.sync.rejected == {"revoked": 5} and played.store.commits == commits
    assert played.sync.hash() == found and not played.took(Ack) and not played.took(Welcome)
    assert played.sync.revoked == (A,) and played.sync.telemetry()["robots_revoked"] == 1
    played.step((B, Batch(1, records([3], seq=2, height=150))))
    assert played.took(Ack), "others go on"


def test_it_is_done_once_and_outlives_any_restart(played) -> None:
    for _ in range(3):
        played.sync.revoke(A)
        played.step()
    commits, found = played.store.commits, (played.sync.hash(), played.sync.first_confident_ns.tolist())
    assert [kind for kind, _ in played.notes].count("revoked") == 1
    played.restart()
    played.step()
    assert (played.sync.hash(), played.sync.first_confident_ns.tolist()) == found and played.sync.revoked == (A,)
    assert played.store.commits == commits + 1, "the restart alone"


def test_a_full_disk_leaves_the_robot_in_until_it_is_asked_again(played) -> None:
    found, played.store.full = played.sync.hash(), True
    played.sync.revoke(A)
    played.step()
    assert played.sync.revoked == () and played.sync.hash() == found
    played.store.full = False
    played.sync.revoke(A)
    played.step()
    assert played.sync.revoked == (A,)


@pytest.mark.parametrize("outcome", ["lost", "kept"])
def test_a_failed_sync_leaves_all_or_nothing(played, outcome) -> None:
    before, played.store.fail_next = played.sync.hash(), outcome
    played.sync.revoke(A)
    with pytest.raises(StoreFailed):
        played.step()
    played.restart()
    assert played.sync.revoked == ((A,) if outcome == "kept" else ()) and (played.sync.hash() != before) == (
        outcome == "kept"
    )


CELLS = st.builds(
    lambda cells, height, tick, confidence, seq: records(sorted(cells), seq, height, tick, confidence),
    st.sets(st.integers(0, SIZE - 1), min_size=1), st.integers(-500, 500), st.integers(0, 3_000), st.integers(1, 255),
    st.integers(1, 9),
)  # fmt: skip


@settings(max_examples=50, deadline=None)
@given(st.lists(st.tuples(st.sampled_from([A, B]), CELLS), max_size=6), st.integers(0, 6), st.booleans())
def test_whatever_came_before_and_after_it_is_the_map_without_it(batches, revoked_at, restarts) -> None:
    with_it, without_it = Played(), Played()
    without_it.sync.revoke(A)
    without_it.step()
    for i, (robot, batch) in enumerate([*batches, (B, records([0]))]):
        if i == min(revoked_at, len(batches)):
            with_it.sync.revoke(A)
        if i == revoked_at + 1 and restarts:
            with_it.restart()
        for played in (with_it, without_it):
            played.step((robot, Batch(1, batch)), seconds=1)
    assert np.array_equal(with_it.sync.registers(), without_it.sync.registers())
    assert with_it.sync.hash() == without_it.sync.hash()
