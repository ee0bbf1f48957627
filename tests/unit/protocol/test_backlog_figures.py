"""What a robot tells of its backlog: how old the oldest unacknowledged cell is, and which batches went unanswered."""

from __future__ import annotations

import numpy as np
import pytest
from orograph.messages import ACKED, REGISTER, UPDATE, Ack, Batch, Digest, Hello, Welcome
from orograph.protocol.robot import RobotSync
from orograph.protocol.tiles import Tiles

SHAPE = (40, 40)
SIZE = 1600
S = 1_000_000_000


def records(cells, height: int) -> np.ndarray:
    out = np.zeros(len(cells), UPDATE)
    out["cell"], out["height"], out["confidence"] = cells, height, 50
    return out


class Joined:
    """A robot in epoch 1, stepped by hand."""

    def __init__(self) -> None:
        prior = np.zeros(SIZE, UPDATE)
        prior["cell"] = np.arange(SIZE)
        self.sync, self.sent = RobotSync("robot_001", SHAPE, prior, bytes(range(16)), seed=1), []
        self.step(0)
        nonce = next(m.nonce for m in self.sent if isinstance(m, Hello))
        self.step(0, Welcome(nonce, 1, 1, 0, 1, np.zeros(0, REGISTER)))

    def step(self, at_s: float, *inbox) -> None:
        self.sync.step(round(at_s * S), inbox, self.sent.append)

    def tells(self, figure: str) -> float:
        return self.sync.telemetry()[figure]

    def batches(self) -> list[Batch]:
        return [message for message in self.sent if isinstance(message, Batch)]


def ack_of(batch: Batch, cells) -> Ack:
    some = batch.records[np.isin(batch.records["cell"], cells)]
    acked = np.zeros(len(some), ACKED)
    acked["cell"], acked["seq"] = some["cell"], some["seq"]
    return Ack(batch.epoch, acked)


@pytest.fixture
def robot() -> Joined:
    return Joined()


def test_nothing_waits_nothing_is_old(robot: Joined) -> None:
    robot.step(100)
    assert robot.tells("oldest_waiting_s") == 0


def test_the_oldest_cell_counts_until_it_is_acknowledged(robot: Joined) -> None:
    robot.step(10)
    robot.sync.offer(records([1, 2], 100))
    robot.step(11)
    robot.sync.offer(records([3], 100))
    robot.step(14)
    assert robot.tells("oldest_waiting_s") == pytest.approx(4)
    robot.step(15, *(ack_of(batch, [1, 2]) for batch in robot.batches()))
    assert robot.tells("waiting_cells") == 1
    assert robot.tells("oldest_waiting_s") == pytest.approx(4), "cell 3 waits since second 11"


def test_a_cell_that_changes_again_before_its_ack_keeps_its_age(robot: Joined) -> None:
    robot.sync.offer(records([1], 100))
    for second in range(1, 8):
        robot.step(second)
        robot.sync.offer(records([1], 100 + second))
    assert robot.tells("oldest_waiting_s") == pytest.approx(7)


def test_unanswered_batches_are_counted_and_answered_ones_are_not(robot: Joined) -> None:
    robot.sync.offer(records([1], 100))
    for tenth in range(1, 31):
        robot.step(tenth / 10)
    sent = robot.tells("batches_sent")
    assert 2 <= sent <= 4 and robot.tells("batches_unanswered") in {sent - 1, sent}
    robot.step(3.1, ack_of(robot.batches()[-1], [1]))
    unanswered = robot.tells("batches_unanswered")
    for tenth in range(32, 80):
        robot.step(tenth / 10)
    assert robot.tells("batches_unanswered") == unanswered


def test_a_digest_that_still_differs_after_an_answer_is_counted(robot: Joined) -> None:
    other = np.ones((Tiles(SHAPE).count, 16), "u1")
    robot.step(1, Digest(1, 0, other))
    assert robot.tells("copy_mismatches") == 1
    robot.step(2, Digest(1, 0, other[:1]))
    assert (robot.tells("copy_mismatches"), robot.tells("copy_rejected")) == (1, 1)
