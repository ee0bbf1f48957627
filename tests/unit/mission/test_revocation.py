"""What becomes of a patrol when one of its robots is revoked."""

from __future__ import annotations

import numpy as np
import pytest
from made_up.street import Run, everything, street
from orograph import keys
from orograph.messages import ManagerStatus


@pytest.mark.parametrize("restarts", [False, True])
def test_a_revoked_robot_stands_still_and_all_that_it_visited_is_visited_again(restarts: bool) -> None:
    run = Run(street(2, 8))
    run.until(40)
    its = set(run.drivers["robot_002"].visited)
    run.revoked, run.copy_hash["robot_002"] = np.array([2], "<u2"), b"o" * 16
    run.until(43)
    if restarts:
        run.restart()
    at_m = run.drivers["robot_002"].at_m
    run.until(900)
    assert its and run.drivers["robot_002"].at_m == at_m
    assert run.end is not None and run.end.complete and run.end.copies_equal
    assert set(run.drivers["robot_001"].visited) == everything(run)
    assert set(run.node.artifacts()["visited_by"].tolist()) == {1} and not run.node.artifacts()["gone"].size


def test_an_old_word_of_the_manager_brings_no_revoked_robot_back() -> None:
    run = Run(street(2, 8))
    run.revoked = np.array([2], "<u2")
    run.until(30)
    run._post(keys.MANAGER, ManagerStatus(5 * 10**9, 7, b"m" * 16, 0, run.revoked[:0]))
    run.step()
    assert run.node.revoked == {"robot_002"} and not run.noted("robot-back")


def test_a_mission_without_a_robot_left_ends() -> None:
    run = Run(street(1, 8))
    run.until(10)
    run.revoked = np.array([1], "<u2")
    run.until(60)
    assert run.end is not None and not run.end.complete
