"""Every chaos checker shown once to pass and once to fail, on a run without containers and made-up lines."""

from __future__ import annotations

import copy
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from chaos import checkers
from chaos.cluster import call
from chaos.evidence import Action, Evidence, read, settled_s
from chaos.experiments import EXPERIMENTS, chosen
from chaos.runner import SEED, _carry_out_all, measure, summary, table
from orograph.keys import robot_id
from orograph.launch.lifecycle import run
from orograph.storage.scenario_file import load_scenario

Line = dict[str, Any]
ROBOT = "robot_001"


def figures(at: float, **values: float) -> Line:
    known = {"copy_version": 9.0, "waiting_cells": 3.0, "batches_in_flight": 1.0, "copy_digest_matches": 4.0}
    return {"kind": "figures", "at": at, "node": f"robot-mapping/{ROBOT}", "figures": {**known, **values}}


def batch(at: float, frame: int, epoch: int, cell: int, seq: int, confidence: int) -> Line:
    return {"kind": "Batch", "at": at, "robot": ROBOT, "frame": frame, "epoch": epoch, "cell": [cell], "seq": [seq],
            "tick": [frame], "confidence": [confidence]}  # fmt: skip


def ack(at: float, frame: int, epoch: int, cell: int, seq: int) -> Line:
    return {"kind": "Ack", "at": at, "robot": ROBOT, "frame": frame, "epoch": epoch, "cell": [cell], "seq": [seq]}


def digest(epoch: int, version: int, text: str) -> Line:
    return {"kind": "Digest", "at": 1.0, "robot": "", "frame": 1, "manager_epoch": epoch, "version": version,
            "hash": text}  # fmt: skip


@pytest.fixture(scope="module")
def kept(tmp_path_factory: pytest.TempPathFactory) -> Evidence:
    scenario = load_scenario("scenarios/tiny")
    out = run(scenario, tmp_path_factory.mktemp("chaos") / "run", in_process=True)
    return read(out, [], [])


@pytest.fixture
def evidence(kept: Evidence) -> Evidence:
    """A mission without a fault, with a few lines as the witness would have written them."""
    mine = kept.ledger.held[kept.ledger.held["robot"] == 1][0]
    epoch, cell, seq = int(mine["epoch"]), int(mine["cell"]), int(mine["seq"])
    told = copy.copy(kept)
    told.lines = [
        digest(1, 5, "a"), figures(1.0), batch(1.0, 10, epoch, cell, seq, 40), ack(1.1, 11, epoch, cell, seq),
        digest(1, 9, "b"), figures(2.0),
    ]  # fmt: skip
    told.actions = [Action(0.5, 5, "a fault"), Action(1.5, 15, "its end", heals=True)]
    told.healthy, told.restarted = (ROBOT,), {}
    return told


def test_a_mission_without_faults_is_green(evidence: Evidence) -> None:
    assert list(checkers.violations(evidence)) == []


def ledger(evidence: Evidence, **changes: Any) -> None:
    evidence.ledger = replace(evidence.ledger, **changes)


def lines(evidence: Evidence, *more: Line) -> None:
    evidence.lines = [*evidence.lines, *more]


def broken_copy(evidence: Evidence) -> None:
    copies = {robot: cells.copy() for robot, cells in evidence.ledger.copies.items()}
    copies[ROBOT]["height"][7] += 1
    ledger(evidence, copies=copies)


def broken_own(evidence: Evidence) -> None:
    own = {robot: records.copy() for robot, records in evidence.ledger.own.items()}
    own[ROBOT]["confidence"][0] -= 1
    ledger(evidence, own=own)


def broken_map(evidence: Evidence) -> None:
    glrm = evidence.ledger.glrm
    assert glrm is not None
    changed = glrm.copy()
    changed["height"][int(evidence.ledger.held["cell"][0])] += 1
    ledger(evidence, glrm=changed)


def unfinished(evidence: Evidence) -> None:
    evidence.parts = replace(evidence.parts, run=evidence.parts.run.model_copy(update={"complete": False}))


def forgotten_in_the_database(evidence: Evidence) -> None:
    evidence.stored = evidence.stored[1:]


def fenced_for_nothing(evidence: Evidence) -> None:
    event = {"event": "fenced", "robot": ROBOT, "epoch": 1, "stamp_ns": 0}
    evidence.parts = replace(evidence.parts, events=(*evidence.parts.events, event))


def restarted_poorer(evidence: Evidence) -> None:
    evidence.restarted = {ROBOT: 1}
    lines(evidence, batch(2.0, 20, 99, int(evidence.lines[2]["cell"][0]), 1, 10))


MUTATIONS: list[tuple[str, Callable[[Evidence], None]]] = [
    ("0:", unfinished),
    ("1:", lambda e: ledger(e, held=e.ledger.held[1:])),
    ("1:", lambda e: lines(e, ack(1.2, 12, 77, 3, 1))),
    ("1:", forgotten_in_the_database),
    ("2:", broken_copy),
    ("3:", broken_own),
    ("3:", broken_map),
    ("4:", lambda e: lines(e, figures(3.0, copy_version=8.0))),
    ("4:", lambda e: lines(e, digest(2, 8, "c"))),
    ("4:", lambda e: lines(e, digest(2, 9, "c"))),
    ("5:", lambda e: lines(e, figures(3.0, batches_in_flight=5.0))),
    ("5:", lambda e: lines(e, figures(3.0, overflowed=1.0))),
    ("5:", lambda e: lines(e, figures(3.0, rss_max_bytes=5e8))),
    ("7:", lambda e: setattr(e, "recovered", (e.recovered[0], b"other"))),
    ("8:", lambda e: lines(e, figures(3.0, rejected_crc=1.0))),
    ("9:", fenced_for_nothing),
    ("10:", restarted_poorer),
    ("12:", lambda e: lines(e, batch(1.2, 12, 1, 999, 5, 9), ack(3.9, 60, 1, 999, 5))),
]


@pytest.mark.parametrize(("prefix", "mutate"), MUTATIONS)
def test_a_broken_promise_is_seen(prefix: str, mutate: Callable[[Evidence], None], evidence: Evidence) -> None:
    mutate(evidence)
    assert any(found.startswith(prefix) for found in checkers.violations(evidence))


def test_settling_is_the_first_digest_that_all_agree_with(evidence: Evidence) -> None:
    evidence.parts = replace(evidence.parts, run=evidence.parts.run.model_copy(update={"robots": 1}))
    assert settled_s(evidence) is None
    lines(evidence, figures(3.0, copy_digest_matches=5.0))
    assert settled_s(evidence) == pytest.approx(1.5)


def test_a_verdict_is_a_line_of_the_table(evidence: Evidence) -> None:
    verdict = {"experiment": "F0", "what": "no fault", "seed": SEED, "ok": False, "violations": ["1: lost"],
               "figures": measure(evidence)}  # fmt: skip
    told = table([verdict])
    assert "RED (!)" in told and "1: lost" in told
    assert summary([verdict])["failed"] == ["F0"]


def test_experiments_are_chosen_by_name() -> None:
    assert [e.name for e in chosen("F1, F27")] == ["F1", "F1b", "F27a", "F27b", "F27c"]
    assert len(chosen("")) == len(EXPERIMENTS) == len({e.name for e in EXPERIMENTS})
    with pytest.raises(ValueError, match="F99"):
        chosen("F99")


def test_what_has_no_time_left_counts_as_failed(tmp_path: Path) -> None:
    (verdict,) = _carry_out_all(chosen("F8"), tmp_path, deadline_s=0.0)
    assert not verdict["ok"] and "time was up" in (tmp_path / "F8.json").read_text()


def test_mutants_stand_outside_the_product(tmp_path: Path) -> None:
    product = call("git", "grep", "-l", "-i", "mutant", "--", "shared", "services", "ops", check=False)
    assert product == ""
    assert robot_id(1) == ROBOT
