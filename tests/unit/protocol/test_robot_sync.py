"""The robot's side alone: epochs, batches, back-off, fencing; the manager is played by hand."""

from __future__ import annotations

import numpy as np
import pytest
from made_up.cells import flat_prior
from orograph.messages import (
    ACKED,
    CELL,
    REGISTER,
    UPDATE,
    Ack,
    Batch,
    CellsRequest,
    Delta,
    Digest,
    Fenced,
    Hello,
    Pose,
    Welcome,
)  # fmt: skip
from orograph.protocol.robot import RobotSync

SHAPE = (40, 40)
SIZE = 1600
NONCE = bytes(range(16))
S = 1_000_000_000


def records(cells, height=100, tick=0) -> np.ndarray:
    out = np.zeros(len(cells), UPDATE)
    out["cell"], out["height"], out["tick"], out["confidence"] = cells, height, tick, 50
    return out


def row(cells, height=7) -> np.ndarray:
    out = np.zeros(len(cells), REGISTER)
    out["cell"], out["height"], out["confidence"], out["epoch"], out["seq"] = cells, height, 90, 1, 5
    return out


def ack_of(batch: Batch) -> Ack:
    acked = np.zeros(len(batch.records), ACKED)
    acked["cell"], acked["seq"] = batch.records["cell"], batch.records["seq"]
    return Ack(batch.epoch, acked)


def acknowledged(robot) -> np.ndarray:
    held = robot.sync.acknowledged
    return held[held["confidence"] > 0]


class Played:
    """A robot, a clock and what it sent."""

    def __init__(self, seed=1):
        self.sync = RobotSync("robot_001", SHAPE, flat_prior(SIZE), NONCE, seed)
        self.now_ns = 0
        self.sent = []

    def step(self, *inbox, seconds=0.1):
        self.now_ns += round(seconds * S)
        return self.sync.step(self.now_ns, inbox, self.sent.append)

    def take(self, kind) -> list:
        found = [message for message in self.sent if isinstance(message, kind)]
        self.sent = [message for message in self.sent if not isinstance(message, kind)]
        return found

    def join(self, epoch=1, held=None):
        self.step()
        nonce = self.take(Hello)[-1].nonce
        return self.step(Welcome(nonce, epoch, 1, 0, 1, row([]) if held is None else held))


@pytest.fixture
def robot():
    return Played()


def test_nothing_but_hello_before_the_welcome(robot):
    robot.sync.offer(records([1, 2]))
    for _ in range(100):
        robot.step()
    assert {type(message) for message in robot.sent} == {Hello}
    assert 4 <= len(robot.sent) <= 7, "0.5 s, 1 s, 2 s, then every 4 s, within 20 %"
    assert not robot.sync.flushed


def test_offer_is_sent_until_acknowledged(robot):
    robot.join()
    robot.sync.offer(records([1, 2]))
    robot.step()
    (batch,) = robot.take(Batch)
    assert batch.records["cell"].tolist() == [1, 2]
    robot.step(ack_of(batch))
    assert acknowledged(robot)["cell"].tolist() == [1, 2] and robot.sync.flushed
    assert (acknowledged(robot)["epoch"] == 1).all() and acknowledged(robot)["height"].tolist() == [100, 100]


def test_lost_batch_goes_again_with_back_off(robot):
    robot.join()
    robot.sync.offer(records([1]))
    gaps_s, last_ns = [], None
    while len(gaps_s) < 5:
        robot.step()
        if robot.take(Batch):
            gaps_s += [] if last_ns is None else [(robot.now_ns - last_ns) / S]
            last_ns = robot.now_ns
    assert gaps_s == sorted(gaps_s) and 3.2 <= gaps_s[-1] <= 4.9


def test_the_same_value_offered_again_keeps_its_seq(robot):
    robot.join()
    robot.sync.offer(records([1]))
    robot.step()
    (batch,) = robot.take(Batch)
    robot.sync.offer(records([1]))
    robot.step(ack_of(batch))
    assert len(acknowledged(robot)) == 1


def test_ack_of_an_older_seq_leaves_the_cell_dirty(robot):
    robot.join()
    robot.sync.offer(records([1, 2]))
    robot.step()
    (batch,) = robot.take(Batch)
    robot.sync.offer(records([2], height=200))
    robot.step(ack_of(batch))
    assert acknowledged(robot)["cell"].tolist() == [1]
    assert robot.sync.waiting_cells == 1


def test_ack_outside_the_map_is_ignored(robot):
    robot.join()
    robot.sync.offer(records([1]))
    robot.step()
    acked = np.array([(2**32 - 1, 1)], ACKED)
    robot.step(Ack(1, acked))
    assert len(acknowledged(robot)) == 0


def test_at_most_four_batches_of_256_in_flight(robot):
    robot.join()
    robot.sync.offer(records(range(SIZE)))
    for _ in range(9):
        robot.step()
    batches = robot.take(Batch)
    assert [len(batch.records) for batch in batches] == [256] * 4
    assert len(np.unique(np.concatenate([batch.records["cell"] for batch in batches]))) == 1024


def test_backlog_gives_a_share_to_the_largest_change(robot):
    robot.join(held=row(range(600), height=100))
    for cell in range(599):
        robot.sync.offer(records([cell], height=150))
    robot.sync.offer(records([599], height=9_000))
    robot.step()
    batch = robot.take(Batch)[0]
    assert 599 in batch.records["cell"] and set(range(192)) <= set(batch.records["cell"].tolist())


def test_outbox_holds_one_record_per_cell_for_any_outage(robot):
    robot.join()
    for tick in range(200):
        robot.sync.offer(records([1, 2, 3], height=tick, tick=tick))
        robot.step()
    assert robot.sync.waiting_cells == 3


def test_first_welcome_gives_the_whole_row_and_lets_it_stand(robot):
    robot.sync.offer(records([1, 2]))
    result = robot.join(epoch=4, held=row([2, 3]))
    assert result.first_life and result.adopted["cell"].tolist() == [2, 3]
    own = {int(r["cell"]): int(r["height"]) for r in robot.sync.own if r["confidence"]}
    assert own == {1: 100, 2: 7, 3: 7}
    robot.step(seconds=1)
    assert robot.take(Batch)[0].records["cell"].tolist() == [1]


def test_welcome_comes_in_parts_in_any_order_and_twice(robot):
    robot.step()
    nonce = robot.take(Hello)[0].nonce
    parts = [Welcome(nonce, 3, 1, i, 3, row([i])) for i in (2, 0, 0, 2)]
    assert len(robot.step(*parts).adopted) == 0
    assert robot.step(Welcome(nonce, 3, 1, 1, 3, row([1]))).adopted["cell"].tolist() == [0, 1, 2]
    assert len(robot.step(*parts).adopted) == 0


def test_welcome_for_another_nonce_is_not_ours(robot):
    robot.step()
    robot.step(Welcome(bytes(16), 3, 1, 0, 1, row([])))
    assert robot.sync.epoch is None


def test_ghost_fences_once_then_hello_again_and_resend(robot):
    robot.join(epoch=1)
    robot.sync.offer(records([1]))
    robot.step(seconds=1)
    (batch,) = robot.take(Batch)
    robot.step(ack_of(batch))
    robot.sync.offer(records([5]))
    robot.step(Fenced(1))
    robot.take(Hello)
    assert robot.sync.fenced and robot.sync.epoch is None
    for _ in range(31):
        robot.step()
    (hello, *_) = robot.take(Hello)
    assert hello.nonce != NONCE and not robot.take(Batch)
    result = robot.step(Welcome(hello.nonce, 3, 1, 0, 1, row([1], height=100)))
    assert not result.first_life
    robot.step(seconds=1)
    assert set(robot.take(Batch)[0].records["cell"].tolist()) == {1, 5}, "the row of cell 1 differs in confidence"


def test_ack_of_a_later_epoch_fences_who_is_fenced_for_good(robot):
    robot.join(epoch=1)
    robot.step(Fenced(1), Ack(2, np.zeros(0, ACKED)))
    for _ in range(1000):
        robot.step()
    assert not robot.take(Hello) and robot.sync.fenced and robot.sync.telemetry()["fenced"] == 1


def test_ack_of_a_later_epoch_alone_is_asked_about_and_forgotten(robot):
    """It may be forged: the manager, asked with the old nonce, says that the epoch lasts."""
    robot.join(epoch=1, held=row([1]))
    robot.sync.offer(records([2]))
    robot.step(Ack(2, np.zeros(0, ACKED)), seconds=1)
    assert [hello.nonce for hello in robot.take(Hello)] == [NONCE] and not robot.take(Batch)
    robot.step(Welcome(NONCE, 1, 1, 0, 1, row([1])))
    robot.step(seconds=1)
    assert robot.sync.epoch == 1 and robot.take(Batch)[-1].records["cell"].tolist() == [2]
    assert robot.sync.telemetry()["foreign_acks"] == 1 and not robot.sync.fenced


def test_ack_of_a_later_epoch_is_true_when_the_manager_says_so(robot):
    robot.join(epoch=1)
    robot.step(Ack(2, np.zeros(0, ACKED)), seconds=1)
    robot.step(Fenced(1), Welcome(NONCE, 1, 1, 0, 1, row([])))
    assert robot.sync.fenced


@pytest.mark.parametrize("fenced", [False, True])
def test_ack_of_an_epoch_beyond_all_is_counted_alone(robot, fenced):
    robot.join(epoch=1)
    robot.step(*([Fenced(1)] if fenced else []), Ack(2**32 - 1, np.zeros(0, ACKED)))
    for _ in range(40):
        robot.step()
    assert bool(robot.take(Hello)) == fenced and robot.sync.telemetry()["foreign_acks"] == 1


# --- a manager that begins another life ------------------------------------------------------------------------------


def follow(robot, manager_epoch):
    """The robot's copy hears another life of the manager, asks it and is answered."""
    robot.step(Digest(manager_epoch, 0, np.zeros((4, 16), np.uint8)))
    for _ in range(10):
        robot.step()
    question = robot.take(CellsRequest)[-1]
    assert question.manager_epoch == manager_epoch
    nothing = np.zeros(0, CELL)
    robot.step(Delta(manager_epoch, question.since_version, 0, 0, 1, True, nothing))


def joined_and_acknowledged(robot, cells):
    robot.step(Digest(1, 0, np.zeros((4, 16), np.uint8)))
    robot.join(epoch=1)
    robot.sync.offer(records(cells))
    robot.step(seconds=1)
    (batch,) = robot.take(Batch)
    robot.step(ack_of(batch))
    assert robot.sync.flushed
    robot.take(Hello)
    return batch


@pytest.mark.parametrize("manager_epoch", [2, 77_000])
def test_a_manager_that_lost_its_store_is_offered_the_whole_row_again(robot, manager_epoch):
    batch = joined_and_acknowledged(robot, [1, 2, 3])
    follow(robot, manager_epoch)
    assert not robot.sync.flushed
    hello, *_ = robot.take(Hello)
    assert hello.nonce == NONCE, "the same instance"
    robot.sync.offer(records([4]))
    robot.step(ack_of(batch), seconds=1)
    assert not robot.take(Batch), "nothing is written, and no ack taken, until the row has come"
    result = robot.step(Welcome(NONCE, 9, manager_epoch, 0, 1, row([])))
    assert not result.first_life
    robot.step(seconds=1)
    batch = robot.take(Batch)[-1]
    assert batch.epoch == 9 and batch.records["cell"].tolist() == [1, 2, 3, 4]
    assert robot.sync.telemetry()["registers_lost"] == robot.sync.registers_lost == 3
    robot.step(ack_of(batch))
    assert robot.sync.flushed


def test_a_manager_that_holds_an_older_copy_is_offered_what_it_lacks(robot):
    joined_and_acknowledged(robot, [1, 2])
    robot.sync.offer(records([2], height=300))
    robot.step(seconds=1)
    (batch,) = robot.take(Batch)
    robot.step(ack_of(batch))
    old = row([1, 2], height=100)
    old["confidence"], old["seq"] = 50, [1, 2]
    follow(robot, 2)
    robot.step(Welcome(NONCE, 1, 2, 0, 1, old))
    robot.step(seconds=1)
    assert robot.take(Batch)[-1].records["cell"].tolist() == [2] and robot.sync.registers_lost == 1


def test_a_manager_that_restarted_has_lost_nothing(robot):
    joined_and_acknowledged(robot, [1, 2])
    robot.sync.offer(records([2], height=300))
    robot.step(seconds=1)
    (batch,) = robot.take(Batch)
    held = row([1, 2], height=[100, 300])
    held["confidence"], held["seq"] = 50, [1, int(batch.records["seq"][0])]
    follow(robot, 2)
    robot.take(Batch)
    robot.step(Welcome(NONCE, 1, 2, 0, 1, held))
    robot.step(seconds=1)
    assert robot.sync.flushed and not robot.take(Batch) and robot.sync.registers_lost == 0


def test_a_late_welcome_of_an_earlier_life_does_not_answer(robot):
    joined_and_acknowledged(robot, [1])
    follow(robot, 2)
    robot.step(Welcome(NONCE, 1, 1, 0, 1, row([1])))
    assert not robot.sync.flushed and robot.sync.registers_lost == 0


def test_fenced_epoch_of_somebody_else_is_ignored(robot):
    robot.join(epoch=2)
    robot.step(Fenced(1))
    assert not robot.sync.fenced


def test_link_is_up_for_five_seconds_after_a_word(robot):
    assert not robot.sync.link_up(0)
    robot.join()
    assert robot.sync.link_up(robot.now_ns + 5 * S) and not robot.sync.link_up(robot.now_ns + 5 * S + 1)


def test_link_that_comes_back_is_used_at_once(robot):
    robot.join()
    robot.sync.offer(records([1]))
    for _ in range(300):
        robot.step()
    robot.take(Batch)
    robot.step(Fenced(99))
    for _ in range(4):
        robot.step()
    assert robot.take(Batch)


def test_unexpected_message_is_counted(robot):
    robot.step(Pose(0, 0, 0, 0, 0, 0, 0, 0))
    assert robot.sync.telemetry()["unexpected"] == 1


def test_digest_that_differs_is_answered_by_a_request(robot):
    robot.step(Digest(1, 0, np.zeros((4, 16), np.uint8)))
    for _ in range(5):
        robot.step()
    request = robot.take(CellsRequest)[0]
    assert request.tiles.tolist() == [0, 1, 2, 3]


def test_jitter_follows_from_the_seed():
    def times(seed):
        robot = Played(seed)
        robot.join()
        found = []
        for tick in range(100):
            robot.sync.offer(records([1], tick=tick))
            robot.step()
            for batch in robot.take(Batch):
                found.append(robot.now_ns)
                robot.step(ack_of(batch), seconds=0)
        return found

    assert times(1) == times(1) and times(1) != times(2)
