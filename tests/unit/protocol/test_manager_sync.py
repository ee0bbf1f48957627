"""The manager's side alone: commit before ack, epochs, rejections, downlink; robots are played by hand."""

from __future__ import annotations

import numpy as np
import pytest
from made_up.cells import flat_prior
from orograph.messages import UPDATE, Ack, Batch, CellsRequest, Delta, Digest, Fenced, Hello, Pose, Welcome
from orograph.protocol.limits import LIMITS, Limits
from orograph.protocol.manager import ManagerSync
from orograph.protocol.store import MemoryStore, StoreFailed
from orograph.rules import SURFACE

SHAPE = (40, 40)
SIZE = 1600
A, B = "robot_001", "robot_002"
NO_TILES = np.zeros(0, "<u2")


def records(cells, seq=1, height=100, tick=0, confidence=50) -> np.ndarray:
    out = np.zeros(len(cells), UPDATE)
    out["cell"], out["height"], out["tick"], out["confidence"] = cells, height, tick, confidence
    out["seq"] = seq
    return out


class Played:
    """A manager, its store, a clock, what it sent, what it noted."""

    def __init__(self, limits=LIMITS):
        self.store, self.now_ns, self.sent, self.notes = MemoryStore(), 0, [], []
        self.limits = limits
        self.restart()

    def restart(self):
        self.sync = ManagerSync(SHAPE, flat_prior(SIZE), SURFACE, self.store, [A, B], limits=self.limits)

    def step(self, *inbox, seconds=0.1):
        self.now_ns += round(seconds * 1e9)
        self.sync.step(
            self.now_ns, inbox, lambda to, m: self.sent.append((to, m)), lambda kind, _: self.notes.append(kind)
        )

    def take(self, kind, to=None) -> list:
        found = [m for robot, m in self.sent if isinstance(m, kind) and to in (None, robot)]
        self.sent = [(robot, m) for robot, m in self.sent if not (isinstance(m, kind) and to in (None, robot))]
        return found


@pytest.fixture
def manager():
    played = Played()
    played.step((A, Hello(b"a" * 16)))
    played.sent.clear()
    return played


def test_hello_is_given_an_epoch_once_per_nonce():
    played = Played()
    played.step((A, Hello(b"a" * 16)), (A, Hello(b"a" * 16)), (B, Hello(b"b" * 16)))
    played.step((A, Hello(b"a" * 16)))
    assert {(w.nonce[:1], w.epoch) for w in played.take(Welcome)} == {(b"a", 1), (b"b", 1)}
    played.step((A, Hello(b"c" * 16)))
    assert [w.epoch for w in played.take(Welcome)] == [2]


def test_epochs_survive_a_restart(manager):
    manager.restart()
    manager.step((A, Hello(b"a" * 16)), (A, Hello(b"z" * 16)))
    assert [w.epoch for w in manager.take(Welcome)] == [2] and manager.sync.epoch(A) == 2


def test_batch_is_committed_then_acknowledged_then_published(manager):
    commits = manager.store.commits
    manager.step((A, Batch(1, records([3, 4], seq=7))))
    assert manager.store.commits == commits + 1
    (ack,) = manager.take(Ack, A)
    assert ack.epoch == 1 and ack.acked.tolist() == [(3, 7), (4, 7)]
    manager.step(seconds=1)
    (beat,) = manager.take(Delta)
    assert beat.cells["cell"].tolist() == [3, 4] and (beat.first_version, beat.last_version) == (0, 1)


def test_two_batches_of_one_step_are_one_commit_and_one_version(manager):
    commits = manager.store.commits
    manager.step((A, Batch(1, records([3], seq=2, height=9))), (A, Batch(1, records([3], seq=1))))
    assert manager.store.commits == commits + 1 and manager.sync.version == 1
    assert manager.sync.registers()["height"].tolist() == [9] and len(manager.take(Ack)) == 2


def test_repeated_batch_is_acknowledged_without_a_commit(manager):
    batch = Batch(1, records([3]))
    manager.step((A, batch))
    commits, found = manager.store.commits, manager.sync.hash()
    manager.step((A, batch))
    assert manager.store.commits == commits and manager.sync.hash() == found and len(manager.take(Ack)) == 2


def test_older_seq_does_not_replace_a_newer(manager):
    manager.step((A, Batch(1, records([3], seq=5, height=50))))
    manager.step((A, Batch(1, records([3], seq=4, height=40))))
    assert manager.sync.registers()["height"].tolist() == [50]


def test_new_epoch_replaces_even_with_a_lower_seq(manager):
    manager.step((A, Batch(1, records([3], seq=5, height=50))))
    manager.step((A, Hello(b"n" * 16)))
    manager.step((A, Batch(2, records([3], seq=1, height=10))))
    assert manager.sync.registers()["height"].tolist() == [10]


def test_batch_of_an_older_epoch_is_fenced(manager):
    manager.step((A, Hello(b"n" * 16)))
    found = manager.sync.hash()
    manager.step((A, Batch(1, records([3]))))
    assert [f.epoch for f in manager.take(Fenced, A)] == [1] and not manager.take(Ack)
    assert manager.sync.hash() == found and manager.sync.rejected == {"fenced-epoch": 1} and "fenced" in manager.notes


@pytest.mark.parametrize(
    ("reason", "message"),
    [
        ("cell-range", Batch(1, records([SIZE]))),
        ("duplicate-cell", Batch(1, records([3, 3]))),
        ("no-evidence", Batch(1, records([3], confidence=0))),
        ("no-evidence", Batch(1, records([3], seq=0))),
        ("height-range", Batch(1, records([3], height=10_000_001))),
        ("height-range", Batch(1, records([3], height=-(2**31)))),
        ("future-tick", Batch(1, records([3], tick=1_300))),
        ("shape", Batch(1, records([]))),
        ("shape", Batch(1, records(range(257)))),
        ("shape", Batch(1, np.zeros(3, "<u4"))),
        ("nonce", Hello(b"short")),
        ("tile-range", CellsRequest(1, 0, np.array([4], "<u2"))),
        ("unexpected", Pose(0, 0, 0, 0, 0, 0, 0, 0)),
    ],
)
def test_rejected_input_is_counted_by_reason_and_changes_nothing(manager, reason, message):
    before = (manager.sync.hash(), manager.sync.version, manager.store.commits, manager.sync.epoch(A))
    manager.step((A, message))
    assert manager.sync.rejected == {reason: 1} and manager.notes[-1] == "rejected"
    assert before == (manager.sync.hash(), manager.sync.version, manager.store.commits, manager.sync.epoch(A))
    assert not manager.take(Ack) and not manager.take(Welcome)


def test_tick_just_within_the_future_is_taken(manager):
    manager.step((A, Batch(1, records([3], tick=1_200))))
    assert manager.take(Ack)


def test_unknown_robot_and_flood_are_rejected(manager):
    manager.step(("robot_009", Hello(b"q" * 16)), *[(A, Batch(1, records([3])))] * (LIMITS.messages_per_step + 2))
    assert manager.sync.rejected == {"unknown-robot": 1, "flood": 2}


def test_full_disk_gives_no_ack_and_stays_up(manager):
    manager.store.full = True
    manager.step((A, Batch(1, records([3]))), (B, Hello(b"b" * 16)))
    assert not manager.take(Ack) and not manager.take(Welcome) and manager.sync.version == 0
    assert manager.sync.store_full and manager.sync.telemetry()["store_full"] == 1
    manager.step((A, Batch(1, records([3]))))
    manager.store.full = False
    manager.step((A, Batch(1, records([3]))))
    assert manager.take(Ack) and not manager.sync.store_full
    assert [note for note in manager.notes if "store" in note] == ["store-full", "store-freed"]


def test_full_disk_at_the_start_is_waited_out():
    played = Played()
    played.store.full = True
    played.step((A, Hello(b"a" * 16)))
    assert not played.sent
    played.store.full = False
    played.step((A, Hello(b"a" * 16)))
    assert played.take(Welcome)


@pytest.mark.parametrize("outcome", ["lost", "kept"])
def test_failed_sync_ends_the_manager_without_an_ack(manager, outcome):
    manager.store.fail_next = outcome
    with pytest.raises(StoreFailed):
        manager.step((A, Batch(1, records([3]))))
    assert not manager.take(Ack)
    manager.restart()
    assert len(manager.sync.registers()) == (outcome == "kept")


def test_recovery_gives_the_same_map_version_and_times(manager):
    manager.step((A, Batch(1, records([3, 9], confidence=200))))
    before = (manager.sync.hash(), manager.sync.version, manager.sync.first_confident_ns.tolist())
    manager.restart()
    assert before == (manager.sync.hash(), manager.sync.version, manager.sync.first_confident_ns.tolist())
    assert manager.sync.manager_epoch == 2 and manager.sync.glrm["version"][[3, 9, 4]].tolist() == [1, 1, 0]


def test_first_confident_is_the_first_time_only(manager):
    manager.step((A, Batch(1, records([3], seq=1, confidence=200))))
    first = manager.now_ns
    manager.step((A, Batch(1, records([3], seq=2, confidence=210))))
    assert manager.sync.first_confident_ns[3] == first and manager.sync.first_confident_ns[4] == -1


def test_digest_every_two_seconds_straight_after_the_beat(manager):
    for tick in range(1, 41):
        manager.step((A, Batch(1, records([tick], seq=tick))))
    kinds = [type(m) for _, m in manager.sent if isinstance(m, Digest | Delta)]
    assert kinds.count(Digest) == 2 and 8 <= kinds.count(Delta) <= 10
    versions = [
        m.version if isinstance(m, Digest) else m.last_version for _, m in manager.sent if not isinstance(m, Ack)
    ]
    assert versions == sorted(versions)


def test_beats_join_without_a_gap(manager):
    for tick in range(1, 31):
        manager.step((A, Batch(1, records([tick % 7], seq=tick, height=tick))))
    beats = manager.take(Delta)
    assert [b.first_version for b in beats[1:]] == [b.last_version for b in beats[:-1]]
    assert all(len(np.unique(b.cells["cell"])) == len(b.cells) for b in beats)


def big_map(manager):
    for first in range(0, SIZE, 200):
        manager.step((A, Batch(1, records(range(first, first + 200)))))
    manager.step(seconds=2)
    manager.sent.clear()


def test_snapshot_comes_in_parts_of_1024(manager):
    big_map(manager)
    manager.step((B, CellsRequest(0, 0, NO_TILES)))
    parts = manager.take(Delta, B)
    assert [len(p.cells) for p in parts] == [1024, 576] and {(p.part, p.parts, p.repair) for p in parts} == {
        (0, 2, True), (1, 2, True),
    }  # fmt: skip
    assert {(p.first_version, p.last_version) for p in parts} == {(0, 8)}


def test_request_since_a_version_brings_what_changed_after_it(manager):
    big_map(manager)
    manager.step((B, CellsRequest(1, 7, NO_TILES)))
    (part,) = manager.take(Delta, B)
    assert part.cells["cell"].tolist() == list(range(1400, 1600)) and part.first_version == 7


def test_request_to_another_life_is_counted_and_not_answered(manager):
    big_map(manager)
    manager.step((B, CellsRequest(9, 7, NO_TILES)))
    assert not manager.take(Delta, B) and manager.sync.rejected == {"other-life": 1}


def test_question_for_a_version_that_is_none_is_answered_by_its_number_and_no_cell(manager):
    big_map(manager)
    manager.step((B, CellsRequest(1, 2**32 - 2, NO_TILES)))
    (answer,) = manager.take(Delta, B)
    assert (answer.manager_epoch, answer.first_version, len(answer.cells)) == (1, 2**32 - 2, 0) and answer.repair


def test_batch_of_an_epoch_of_another_store_is_counted_and_not_answered(manager):
    found = manager.sync.hash()
    manager.step((A, Batch(5, records([3]))))
    assert not manager.take(Ack) and not manager.take(Fenced)
    assert manager.sync.hash() == found and manager.sync.rejected == {"unknown-epoch": 1}


def test_hello_whose_epoch_is_over_is_told_so(manager):
    manager.step((A, Hello(b"n" * 16)))
    manager.sent.clear()
    manager.step((A, Hello(b"a" * 16)))
    assert [f.epoch for f in manager.take(Fenced, A)] == [1] and [w.epoch for w in manager.take(Welcome, A)] == [1]


def test_no_number_of_a_life_or_an_epoch_is_given_twice_by_different_stores():
    lives, epochs = [], []
    for draw in (70_000, 1_900_000_000):
        manager = Played()
        for life in range(3):
            manager.sync = ManagerSync(SHAPE, flat_prior(SIZE), SURFACE, manager.store, [A, B], draw=draw + life)
            manager.step((A, Hello(bytes([life]) * 16)), (B, Hello(b"b" * 16)))
            lives.append(manager.sync.manager_epoch)
            epochs.append(manager.sync.epoch(A))
    assert lives == sorted(set(lives)) and epochs == lives and lives[0] == 70_001
    assert lives[2] - lives[0] < 2 * 2**16


def test_request_for_tiles_brings_those_tiles(manager):
    big_map(manager)
    manager.step((B, CellsRequest(1, 8, np.array([3, 3, 0], "<u2"))))
    parts = manager.take(Delta, B)
    assert sum(len(p.cells) for p in parts) == 800 and {p.first_version for p in parts} == {
        p.last_version for p in parts
    }


def test_answers_are_rate_bounded_and_fair():
    manager = Played(Limits(part_cells=20, answers_per_step=4))
    manager.step((A, Hello(b"a" * 16)))
    manager.sent.clear()
    big_map(manager)
    manager.step(
        (A, CellsRequest(0, 0, NO_TILES)), (B, CellsRequest(0, 0, NO_TILES)), (B, CellsRequest(0, 0, NO_TILES))
    )
    assert len(manager.take(Delta, A)) == len(manager.take(Delta, B)) == 2
    for _ in range(100):
        manager.step()
    assert len(manager.take(Delta, A)) == len(manager.take(Delta, B)) == 78


def test_welcome_brings_the_robots_own_row_alone(manager):
    manager.step((A, Batch(1, records([3, 4]))), (B, Hello(b"b" * 16)))
    manager.step((B, Batch(1, records([5]))))
    manager.sent.clear()
    manager.step((A, Hello(b"n" * 16)))
    (welcome,) = manager.take(Welcome, A)
    assert welcome.row["cell"].tolist() == [3, 4] and welcome.row["epoch"].tolist() == [1, 1] and welcome.epoch == 2
