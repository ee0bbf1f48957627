from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from orograph import keys
from orograph.judge.checks import Checks, checks, contacts, lost_cells, own_fold, read_ledger
from orograph.scene.prior import prior_records
from orograph.storage.parts import RunParts

ROBOT = keys.node(keys.MAPPING, "robot_001")
Change = Callable[[np.ndarray], np.ndarray]


def with_array(parts: RunParts, node: str, name: str, change: Change) -> RunParts:
    arrays = {**parts.nodes[node], name: change(parts.nodes[node][name].copy())}
    return replace(parts, nodes={**parts.nodes, node: arrays})


def promises(parts: RunParts) -> Checks:
    return checks(parts, read_ledger(parts), prior_records(parts.scenario))


def judged(parts: RunParts) -> list[bool | None]:
    return [check.ok for check in promises(parts)]


def raised(field: str) -> Change:
    """One more in the first record that holds something."""

    def change(records: np.ndarray) -> np.ndarray:
        records[field][np.flatnonzero(records["confidence"] > 0)[0]] += 1
        return records

    return change


def test_a_good_run_keeps_every_promise(city_run: RunParts) -> None:
    assert judged(city_run) == [True] * 6


def test_one_bit_in_one_copy_is_found(city_run: RunParts) -> None:
    bad = with_array(city_run, ROBOT, "copy", raised("height"))
    assert judged(bad) == [True, True, True, False, True, True]


def test_who_has_gone_is_judged_by_what_was_acknowledged_alone(city_run: RunParts) -> None:
    left = with_array(with_array(city_run, ROBOT, "copy", raised("height")), ROBOT, "registers", raised("height"))
    assert judged(left) == [True, True, True, False, False, True]
    orchestrator = {**left.nodes[keys.ORCHESTRATOR], "gone": np.array([1], np.uint16)}
    left = replace(left, nodes={**left.nodes, keys.ORCHESTRATOR: orchestrator})
    assert judged(left) == [True] * 6
    assert judged(with_array(left, keys.MANAGER, "registers", lambda held: held[held["robot"] != 1]))[-1] is False
    nothing = replace(left, nodes={name: arrays for name, arrays in left.nodes.items() if name != ROBOT})
    assert judged(nothing) == [True] * 6


def test_who_was_revoked_is_not_judged_and_the_run_is_not_called_repeatable(city_run: RunParts) -> None:
    parts = with_array(city_run, keys.MANAGER, "registers", lambda held: held[held["robot"] != 1])
    parts = with_array(parts, ROBOT, "copy", raised("height"))
    manager = {**parts.nodes[keys.MANAGER], "revoked": np.array([1], "<u2")}
    found = own_fold(
        revoked := replace(parts, nodes={**parts.nodes, keys.MANAGER: manager}),
        read_ledger(revoked),
        prior_records(parts.scenario),
    )
    copies = {
        name: {**arrays, "copy": found} for name, arrays in revoked.nodes.items() if "copy" in arrays and name != ROBOT
    }
    revoked = replace(revoked, nodes={**revoked.nodes, **copies, keys.MANAGER: {**manager, "glrm": found}})
    assert judged(revoked) == [True, True, False, True, True, True]
    kept = {
        **manager,
        "glrm": city_run.nodes[keys.MANAGER]["glrm"],
        "registers": city_run.nodes[keys.MANAGER]["registers"],
    }
    assert judged(replace(revoked, nodes={**revoked.nodes, keys.MANAGER: kept}))[4] is False


def test_after_the_run_copies_are_of_the_map_at_its_end(city_run: RunParts) -> None:
    at_end = {**city_run.nodes[keys.MANAGER], "glrm_at_end": city_run.nodes[keys.MANAGER]["glrm"]}
    parts = replace(city_run, nodes={**city_run.nodes, keys.MANAGER: at_end})
    assert judged(with_array(parts, keys.MANAGER, "glrm", raised("height"))) == [True, True, True, True, False, True]


def test_a_version_is_no_part_of_the_map(city_run: RunParts) -> None:
    assert judged(with_array(city_run, ROBOT, "copy", raised("version"))) == [True] * 6


def test_evidence_that_the_manager_folded_otherwise_is_found(city_run: RunParts) -> None:
    bad = with_array(city_run, ROBOT, "registers", raised("height"))
    assert judged(bad) == [True, True, True, True, False, True]


def test_the_fold_is_made_without_the_managers_registers(city_run: RunParts) -> None:
    bad = with_array(city_run, keys.MANAGER, "registers", lambda held: held[:0])
    wanted = own_fold(bad, read_ledger(bad), prior_records(bad.scenario))
    assert np.array_equal(wanted["height"], bad.nodes[keys.MANAGER]["glrm"]["height"])


def test_lost_and_outdated_cells_are_counted(city_run: RunParts) -> None:
    assert lost_cells(read_ledger(city_run), "robot_001") == 0

    def forget(held: np.ndarray) -> np.ndarray:
        first = np.flatnonzero(held["robot"] == 1)
        held["tick"][first[:2]] -= 1
        return np.delete(held, first[2:5])

    bad = with_array(city_run, keys.MANAGER, "registers", forget)
    assert lost_cells(read_ledger(bad), "robot_001") == 5
    assert lost_cells(read_ledger(bad), "robot_002") == 0
    assert judged(bad)[-1] is False


def test_a_newer_register_at_the_manager_is_not_lost(city_run: RunParts) -> None:
    assert judged(with_array(city_run, keys.MANAGER, "registers", raised("tick")))[-1] is True


def test_what_is_missing_is_neither_kept_nor_broken(without: Callable[..., RunParts]) -> None:
    assert judged(without(keys.MANAGER))[3:] == [None, None, None]
    assert judged(without(ROBOT))[3:] == [None, None, None]


def test_an_unfinished_run_says_what_is_missing(city_run: RunParts) -> None:
    bad = replace(city_run, run=city_run.run.model_copy(update={"complete": False, "deterministic": False}))
    found = promises(bad)
    assert [found.complete.ok, found.deterministic.ok] == [False, False]
    assert "A worker died" in found.deterministic.found
    paced = replace(bad, run=bad.run.model_copy(update={"mode": "paced"}))
    assert "Paced time" in promises(paced).deterministic.found

    def visit_all_but(*missed: int) -> RunParts:
        def change(visited_ns: np.ndarray) -> np.ndarray:
            visited_ns[:] = 1
            visited_ns[list(missed)] = -1
            return visited_ns

        return with_array(bad, keys.ORCHESTRATOR, "visited_ns", change)

    assert "Not visited: waypoint 1 of 0 to " in promises(visit_all_but(1)).complete.found
    assert "Not visited: waypoints 0, 1 of 0 to " in promises(visit_all_but(0, 1)).complete.found
    assert promises(visit_all_but()).complete.found == "A robot never flushed."


def test_a_collision_breaks_a_promise_and_the_hardest_is_told(city_run: RunParts) -> None:
    bump = {"stamp_ns": 10**9, "service": "world", "robot": "robot_001", "event": "contact", "body": "building",
            "since_s": 0.5, "newtons": 400, "seconds": 0.1, "x_m": 1.0, "y_m": 2.0}  # fmt: skip
    crash = {**bump, "body": "vehicle_000", "newtons": 14_000, "since_s": 7.25}
    bad = replace(city_run, events=(*city_run.events, bump, crash))
    assert [c.body for c in contacts(bad)] == ["building", "vehicle_000"] and not contacts(city_run)
    check = promises(bad).no_contacts
    assert not check.ok and promises(city_run).no_contacts.ok
    assert check.found == "2 collisions; the hardest: robot_001 and vehicle_000 after 7.2 s, 14,000 N for 0.1 s."
