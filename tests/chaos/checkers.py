"""The invariants of protocol.md asked of the evidence of a real cluster; each returns what it found wrong."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np
from chaos.evidence import Evidence, latencies_s
from oracles.surface_oracle import fold_slowly
from orograph import keys
from orograph.judge import invariants
from orograph.layers import MAPPED_LAYERS
from orograph.protocol.fold import whole_prior
from orograph.protocol.tiles import map_hash
from orograph.rules import Rules
from orograph.scene.prior import prior_records

LATENCY_MAX_S = 2.0
MEMORY_MAX_BYTES = 400e6
"""Of any process on `tiny`: under the smallest limit of compose.yaml for a robot's service (512 MB)."""
KEPT_SHARE = 0.75
"""Of a cell's confidence. A new life gets its row back in coarse cells; where fine ones seen since contradict their
mean, the newer replace it by the rule of mapping.md section 3, so that up to 16 % were seen to go."""
EXPLAINED = ("rejected_fenced_epoch",)
"""Refusals that restarts and conflicts bring; any other means that one of our own sent something bad."""


def mission_ended(e: Evidence) -> list[str]:
    """0: the mission came to its end, every robot flushed, every service left its part."""
    missing = [f"0: {name} left nothing" for name in e.parts.missing() if keys.split(name)[1] not in e.left]
    return missing if e.parts.run.complete else ["0: the mission did not complete", *missing]


def acknowledged_is_kept(e: Evidence) -> list[str]:
    """1: nothing that was seen acknowledged is missing or older, in the manager's memory and in its database."""
    if e.ledger.glrm is None:
        return ["1: the map manager left no registers"]
    acked = invariants.acknowledged(
        (keys.robot_number(line["robot"]), line["epoch"], line["cell"], line["seq"]) for line in e.of("Ack")
    )
    stored = invariants.registers_kept(acked, e.stored)
    return invariants.registers_kept(acked, e.ledger.held) + [f"{found} (in the database)" for found in stored]


def copies_are_equal(e: Evidence) -> list[str]:
    """2: every robot's copy has the manager's hash at the end."""
    if not e.parts.run.complete:
        return ["2: the run never came to rest"]
    wrong = [f"2: {robot} left no copy" for robot in e.staying if robot not in e.ledger.copies]
    copies = {robot: map_hash(copy) for robot, copy in e.ledger.copies.items() if robot not in e.left}
    return wrong + invariants.copies_equal(copies, b"" if e.ledger.glrm is None else map_hash(e.ledger.glrm))


def registers_are_own_evidence(e: Evidence) -> list[str]:
    """3: every register says what its robot's mapper says, whenever the last scan in it was."""
    own = {keys.robot_number(robot): own for robot, own in e.ledger.own.items() if robot not in e.left}
    return invariants.registers_are_own(e.ledger.held, own, ("cell", *MAPPED_LAYERS))


def map_is_the_fold(e: Evidence) -> list[str]:
    """3: the map is the slow reference fold of the registers."""
    if e.ledger.glrm is None:
        return ["3: there is no map"]
    prior = whole_prior(prior_records(e.parts.scenario), e.parts.glrm_grid.size)
    return invariants.map_is_fold(e.ledger.glrm, fold_slowly(prior, e.ledger.held, Rules.of(e.parts.scenario.rules)))


def versions_never_go_back(e: Evidence) -> list[str]:
    """4: a copy's version falls only where the manager or the robot began a new life."""
    lives = len({line["manager_epoch"] for line in e.of("Digest")})
    seen = (
        (robot, 0, int(figures["copy_version"]))
        for robot in e.parts.robots
        for _, figures in e.figures(keys.node(keys.MAPPING, robot))
    )
    falls_allowed = {robot: max(0, lives - 1) + e.restarted.get(robot, 0) for robot in e.parts.robots}
    return invariants.versions_grow(seen, falls_allowed)


def nothing_uncommitted_is_visible(e: Evidence) -> list[str]:
    """4: what one life of the manager published, the next one still has: versions never fall, one version one map."""
    deltas = [(line["manager_epoch"], line["last_version"], None) for line in e.of("Delta")]
    digests = [(line["manager_epoch"], line["version"], line["hash"]) for line in e.of("Digest")]
    return invariants.published_is_kept([*deltas, *digests])


def queues_are_bounded(e: Evidence) -> list[str]:
    """5: outbox, batches in flight, batch size; mailboxes did not overflow; memory stayed under its limit."""
    wrong = []
    for robot in e.parts.robots:
        figures = [of for _, of in e.figures(keys.node(keys.MAPPING, robot))]
        waiting, in_flight = (
            int(max((of[name] for of in figures), default=0)) for name in ("waiting_cells", "batches_in_flight")
        )
        batch = max((len(line["cell"]) for line in e.of("Batch") if line["robot"] == robot), default=0)
        wrong += invariants.uplink_bounded(robot, e.parts.glrm_grid.size, waiting, in_flight, batch)
    for what, figure, most in (
        ("overflows of the mailbox", "overflowed", 0),
        ("memory", "rss_max_bytes", MEMORY_MAX_BYTES),
    ):
        for node, found in _greatest(e, figure).items():
            wrong += invariants.within(f"5: {what} of {node}", found, most)
    return wrong


def _greatest(e: Evidence, figure: str) -> dict[str, float]:
    """Node -> the greatest value of a figure that it showed."""
    out: dict[str, float] = {}
    for line in e.of("figures"):
        out[line["node"]] = max(out.get(line["node"], 0.0), line["figures"].get(figure, 0.0))
    return out


def recovery_is_repeatable(e: Evidence) -> list[str]:
    """7: the database recovers to the same map twice, and to the map that the manager had."""
    once, twice = e.recovered
    in_memory = once if e.ledger.glrm is None else map_hash(e.ledger.glrm)
    return invariants.recovery_repeats(once, twice) + invariants.recovery_repeats(once, in_memory)


def rejected_is_explained(e: Evidence) -> list[str]:
    """8: what was refused is counted by reason, and nothing is refused that our own services sent."""
    seen: dict[tuple[str, str], float] = {}
    for line in e.of("figures"):
        found = {k: v for k, v in line["figures"].items() if k.startswith("rejected_") and k not in EXPLAINED and v}
        seen.update({(line["node"], reason): n for reason, n in found.items()})
    return [f"8: {node} refused {n:.0f} inputs: {reason}" for (node, reason), n in seen.items()]


def fencings_are_explained(e: Evidence) -> list[str]:
    """9: no more fencings than identity conflicts and restarts."""
    fenced = {(x["robot"], x["epoch"]) for x in e.parts.events if x["event"] == "fenced"}
    return invariants.fencings_explained(len(fenced), e.conflicts, sum(e.restarted.values()))


def confidence_survives_restart(e: Evidence) -> list[str]:
    """10: what a robot first says of a cell in a new life is not much less sure than what it said before."""
    return invariants.confidence_kept(fallen(e), KEPT_SHARE, rounding=1)


def fallen(e: Evidence) -> Iterator[tuple[int, int, int, int]]:
    """Cells (robot, cell, before, now) of which a restarted robot's first word is less sure than its last."""
    for robot in e.restarted:
        known: dict[int, tuple[int, int]] = {}
        for line in (line for line in e.of("Batch") if line["robot"] == robot):
            for cell, confidence in zip(line["cell"], line["confidence"], strict=True):
                epoch, before = known.get(cell, (line["epoch"], 0))
                if line["epoch"] > epoch and confidence < before:
                    yield keys.robot_number(robot), cell, before, confidence
                known[cell] = (line["epoch"], confidence)


def healthy_robots_are_served(e: Evidence) -> list[str]:
    """12: while another is at fault, 99 % of a healthy robot's cells are acknowledged within 2 s."""
    heal = e.heal
    if heal is None or not e.healthy:
        return []
    begin = min(a.at for a in e.actions)
    found = latencies_s(e, e.healthy, lambda at: begin <= at <= heal.at)
    p99 = float(np.percentile(found, 99)) if found else 0.0
    return invariants.within(f"12: seconds that healthy robots waited (p99 of {len(found)} cells)", p99, LATENCY_MAX_S)


CHECKERS: tuple[Callable[[Evidence], list[str]], ...] = (
    mission_ended, acknowledged_is_kept, copies_are_equal, registers_are_own_evidence, map_is_the_fold,
    versions_never_go_back, nothing_uncommitted_is_visible, queues_are_bounded, recovery_is_repeatable,
    rejected_is_explained, fencings_are_explained, confidence_survives_restart, healthy_robots_are_served,
)  # fmt: skip


def violations(evidence: Evidence) -> Iterator[str]:
    """What the checkers find wrong, one after the other."""
    for checker in CHECKERS:
        yield from checker(evidence)
