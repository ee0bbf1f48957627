"""Each invariant shown to hold and to break on values small enough to see why."""

from __future__ import annotations

import numpy as np
import pytest
from orograph.judge import invariants
from orograph.messages import CELL, ROBOT_REGISTER, UPDATE

Register = tuple[int, int, int, int]


def registers(*rows: Register) -> np.ndarray:
    """(robot, cell, epoch, seq) with confidence 1."""
    out = np.zeros(len(rows), ROBOT_REGISTER)
    for i, row in enumerate(rows):
        out[i]["robot"], out[i]["cell"], out[i]["epoch"], out[i]["seq"] = row
    out["confidence"] = 1
    return out


def cells(*heights_mm: int) -> np.ndarray:
    out = np.zeros(len(heights_mm), CELL)
    out["cell"], out["height"] = np.arange(len(heights_mm)), heights_mm
    return out


ACKED = (1, 7, 2, 5)


@pytest.mark.parametrize("held", [ACKED, (1, 7, 2, 6), (1, 7, 3, 1)], ids=["same", "newer", "of a later life"])
def test_what_was_acknowledged_may_be_held_in_a_newer_form(held: Register) -> None:
    assert invariants.registers_kept(registers(ACKED), registers((2, 7, 9, 9), held, (1, 8, 1, 1))) == []


def test_what_was_acknowledged_to_a_revoked_robot_is_no_loss_and_must_be_gone() -> None:
    assert invariants.registers_kept(registers(ACKED), registers((2, 7, 9, 9)), revoked={1}) == []
    assert len(invariants.registers_kept(registers(ACKED), registers((2, 7, 9, 9)), revoked={2})) == 1
    assert invariants.revoked_are_out(registers(ACKED), {2}) == []
    assert invariants.revoked_are_out(registers(ACKED, (1, 8, 1, 1)), {1, 2}) == [
        "13: robot 1 was revoked, 2 registers of it are held"
    ]


@pytest.mark.parametrize(
    ("held", "told"),
    [((1, 7, 2, 4), "(2, 4)"), ((1, 7, 1, 9), "(1, 9)"), ((1, 6, 2, 5), "nothing"), ((2, 7, 2, 5), "nothing")],
)
def test_what_was_acknowledged_is_missed_if_older_or_another_s(held: Register, told: str) -> None:
    (found,) = invariants.registers_kept(registers(ACKED), registers(held))
    assert found == f"1: robot 1 cell 7 was acknowledged as (2, 5), held is {told}"


def test_an_empty_manager_has_lost_everything() -> None:
    acked = invariants.acknowledged([(1, 2, [7, 8], [5, 5]), (2, 1, [7], [1])])
    assert len(invariants.registers_kept(acked, registers())) == 3
    assert invariants.registers_kept(acked[:0], registers()) == []


def test_a_register_is_its_robot_s_own_evidence() -> None:
    own = np.zeros(2, UPDATE)
    own["cell"], own["confidence"] = (7, 8), 1
    held = registers((1, 8, 2, 1), (1, 7, 2, 2), (3, 1, 1, 1))
    assert invariants.registers_are_own(held, {1: own}) == []
    assert len(invariants.registers_are_own(held, {1: own[:1]})) == 1
    own["height"][1] = 1
    assert len(invariants.registers_are_own(held, {1: own})) == 1


def test_one_cell_that_is_not_the_fold_is_named() -> None:
    (found,) = invariants.map_is_fold(cells(1, 2, 3), cells(1, 2, 4))
    assert found.startswith("3: cell 2 is (3,")


def test_a_version_falls_only_where_the_manager_began_anew() -> None:
    assert invariants.versions_grow([("a", 1, 5), ("b", 1, 2), ("a", 2, 5), ("a", 2, 6)]) == []
    assert len(invariants.versions_grow([("a", 1, 5), ("a", 1, 4), ("a", 1, 5), ("a", 1, 4)])) == 2
    falling = [("a", 0, 5), ("a", 0, 4)]
    assert invariants.versions_grow(falling, {"a": 1}) == [] != invariants.versions_grow(falling, {"b": 1})


def test_a_version_once_published_stays_and_is_one_map() -> None:
    assert invariants.published_is_kept([(1, 5, "a"), (1, 6, None), (2, 6, "b"), (2, 5, "a")]) != []
    assert invariants.published_is_kept([(1, 5, "a"), (1, 5, "a"), (2, 5, None), (2, 6, "b")]) == []
    assert len(invariants.published_is_kept([(1, 5, "a"), (2, 5, "b")])) == 1


def test_a_copy_holds_nothing_but_what_was_committed_since() -> None:
    since = np.stack([cells(1, 1, 1), cells(1, 2, 1), cells(3, 2, 1)])
    assert invariants.copy_was_committed("a", 4, cells(3, 1, 1), since) == []
    (found,) = invariants.copy_was_committed("a", 4, cells(3, 9, 1), since)
    assert found == "4/6: a at version 4 holds what was never committed since: [1]"


def test_confidence_may_fall_by_the_share_that_is_allowed() -> None:
    changes = [(1, 7, 40, 30), (1, 8, 40, 41)]
    assert len(invariants.confidence_kept(changes)) == 1
    assert invariants.confidence_kept(changes, share=0.75) == []
    assert len(invariants.confidence_kept([(1, 7, 40, 29)], share=0.75)) == 1
    assert invariants.confidence_kept([(1, 7, 40, 29)], share=0.75, rounding=1) == []


def test_bounds_hashes_and_causes() -> None:
    assert invariants.uplink_bounded("a", cells=9, waiting=9, in_flight=4, batch=256) == []
    assert len(invariants.uplink_bounded("a", cells=9, waiting=10, in_flight=5, batch=257)) == 3
    assert invariants.fencings_explained(2, conflicts=1, restarts=1) == []
    assert invariants.fencings_explained(3, conflicts=1, restarts=1) == ["9: fencings: 3, at most 2"]
    for compare in (invariants.recovery_repeats, invariants.map_is_fault_free):
        assert compare(b"x", b"x") == [] != compare(b"x", b"y")
    assert invariants.copies_equal({"a": b"x", "b": b"y"}, b"x") == ["2: b's copy differs"]
