"""The invariants of protocol.md judged from the evidence of a real cluster; each returns what it found wrong.

Where a simulated run is judged by the same rule, that rule's checker is used (`simnet.checkers`).
"""

from __future__ import annotations

import itertools
from collections import defaultdict
from collections.abc import Callable, Iterator

import numpy as np
from chaos.evidence import Evidence, latencies_s
from orograph import keys
from orograph.messages import UPDATE
from orograph.protocol.fold import whole_prior
from orograph.protocol.tiles import map_hash
from orograph.scene.prior import prior_records
from simnet import checkers as simulated
from simnet.history import Acked, History, Load

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
    return missing if e.parts.run.get("complete") else ["0: the mission did not complete", *missing]


def history(e: Evidence) -> History:
    """The part of the evidence that the simulation's checkers know."""
    prior = whole_prior(prior_records(e.parts.scenario), e.parts.glrm_grid.size)
    glrm = e.ledger.glrm
    return History(
        size=e.parts.glrm_grid.size, acked=_acked(e), recovered=[e.recovered], loads=_loads(e),
        manager_hash=b"" if glrm is None else map_hash(glrm),
        copy_hashes={robot: map_hash(copy) for robot, copy in e.ledger.copies.items() if robot not in e.left},
        quiet=bool(e.parts.run.get("complete")), prior=prior, glrm=glrm, registers=e.ledger.held,
        restarts=sum(e.restarted.values()), conflicts=e.conflicts,
        fenced={(str(x["robot"]), int(x["epoch"])) for x in e.parts.events if x["event"] == "fenced"},
    )  # fmt: skip


def _acked(e: Evidence) -> list[Acked]:
    """What the witness saw acknowledged, and what the surviving robots say."""
    return [
        Acked(keys.robot_number(line["robot"]), line["epoch"], np.array(line["cell"]), np.array(line["seq"]))
        for line in e.of("Ack")
    ]


def _loads(e: Evidence) -> dict[str, Load]:
    loads: defaultdict[str, Load] = defaultdict(Load)
    for robot in e.parts.robots:
        for _, figures in e.figures(keys.node(keys.MAPPING, robot)):
            load = loads[robot]
            load.waiting = max(load.waiting, int(figures["waiting_cells"]))
            load.flights = max(load.flights, int(figures["batches_in_flight"]))
    for line in e.of("Batch"):
        load = loads[line["robot"]]
        load.batch_records = max(load.batch_records, len(line["cell"]))
    return dict(loads)


def acknowledged_is_kept(e: Evidence) -> list[str]:
    """1: nothing that was seen acknowledged is missing or older, in the manager's memory and in its database."""
    known = history(e)
    if e.ledger.glrm is None:
        return ["1: the map manager left no registers"]
    wrong = simulated.acknowledged_is_kept(known)
    known.registers = e.stored
    return wrong + [f"{found} (in the database)" for found in simulated.acknowledged_is_kept(known)]


def copies_are_equal(e: Evidence) -> list[str]:
    """2: every robot's copy has the manager's hash at the end."""
    missing = [f"2: {robot} left no copy" for robot in e.staying if robot not in e.ledger.copies]
    return missing + simulated.copies_are_equal(history(e))


def registers_are_own_evidence(e: Evidence) -> list[str]:
    """3: every register says what its robot's mapper says, whenever the last scan in it was."""
    wrong = []
    names = [name for name in UPDATE.names or () if name not in ("seq", "tick")]
    for robot, own in ((robot, own) for robot, own in e.ledger.own.items() if robot not in e.left):
        held = e.ledger.held[e.ledger.held["robot"] == keys.robot_number(robot)]
        if len(held) != len(own) or any(not np.array_equal(held[name], own[name]) for name in names):
            wrong.append(f"3: {robot}'s registers ({len(held)}) are not its own evidence ({len(own)})")
    return wrong


def map_is_the_fold(e: Evidence) -> list[str]:
    """3: the map is the slow reference fold of the registers."""
    return simulated.map_is_the_fold(history(e)) if e.ledger.glrm is not None else ["3: there is no map"]


def versions_never_go_back(e: Evidence) -> list[str]:
    """4: a copy's version falls only where the manager or the robot began a new life."""
    lives = len({line["manager_epoch"] for line in e.of("Digest")})
    wrong = []
    for robot in e.parts.robots:
        seen = [figures["copy_version"] for _, figures in e.figures(keys.node(keys.MAPPING, robot))]
        falls = sum(now < before for before, now in itertools.pairwise(seen))
        allowed = max(0, lives - 1) + e.restarted.get(robot, 0)
        if falls > allowed:
            wrong.append(f"4: {robot}'s version fell {falls} times, new lives {allowed}")
    return wrong


def nothing_uncommitted_is_visible(e: Evidence) -> list[str]:
    """4: what one life of the manager published, the next one still has: versions never fall, one version one map."""
    published: dict[int, list[int]] = {}
    maps: defaultdict[int, set[str]] = defaultdict(set)
    for line in (*e.of("Delta"), *e.of("Digest")):
        version = line["last_version"] if line["kind"] == "Delta" else line["version"]
        published.setdefault(line["manager_epoch"], []).append(version)
        if line["kind"] == "Digest":
            maps[version].add(line["hash"])
    lives = sorted(published)
    wrong = [
        f"4: life {now} of the manager knows version {min(published[now])}, life {before} published"
        f" {max(published[before])}"
        for before, now in itertools.pairwise(lives)
        if min(published[now]) < max(published[before])
    ]
    return wrong + [f"4: version {v} was {len(hashes)} different maps" for v, hashes in maps.items() if len(hashes) > 1]


def queues_are_bounded(e: Evidence) -> list[str]:
    """5: outbox, batches in flight, batch size; mailboxes did not overflow; memory stayed under its limit."""
    wrong = simulated.queues_are_bounded(history(e))
    figures = [(line["node"], line["figures"]) for line in e.of("figures")]
    full = sorted({node for node, of in figures if of.get("overflowed")})
    fat = sorted({node for node, of in figures if of.get("rss_max_bytes", 0.0) > MEMORY_MAX_BYTES})
    wrong += [f"5: the mailbox of {node} overflowed" for node in full]
    return wrong + [f"5: {node} used more than {MEMORY_MAX_BYTES / 1e6:.0f} MB" for node in fat]


def recovery_is_repeatable(e: Evidence) -> list[str]:
    """7: the database recovers to the same map twice, and to the map that the manager had."""
    wrong = simulated.recovery_is_repeatable(history(e))
    if e.ledger.glrm is not None and e.recovered[0] != map_hash(e.ledger.glrm):
        wrong.append("7: the database recovers to another map than the manager had")
    return wrong


def rejected_is_explained(e: Evidence) -> list[str]:
    """8: what was refused is counted by reason, and nothing is refused that our own services sent."""
    seen: dict[tuple[str, str], float] = {}
    for line in e.of("figures"):
        found = {k: v for k, v in line["figures"].items() if k.startswith("rejected_") and k not in EXPLAINED and v}
        seen.update({(line["node"], reason): n for reason, n in found.items()})
    return [f"8: {node} refused {n:.0f} inputs: {reason}" for (node, reason), n in seen.items()]


def fencings_are_explained(e: Evidence) -> list[str]:
    """9: no more fencings than identity conflicts and restarts."""
    return simulated.fencings_are_explained(history(e))


def confidence_survives_restart(e: Evidence) -> list[str]:
    """10: what a robot first says of a cell in a new life is not much less sure than what it said before."""
    return [
        f"10: {robot}'s confidence in cell {cell} fell from {before} to {now}"
        for robot, cell, before, now in fallen(e)
        if now < KEPT_SHARE * before - 1
    ]


def fallen(e: Evidence) -> Iterator[tuple[str, int, int, int]]:
    """Cells (robot, cell, before, now) of which a restarted robot's first word is less sure than its last."""
    for robot in e.restarted:
        known: dict[int, tuple[int, int]] = {}
        for line in (line for line in e.of("Batch") if line["robot"] == robot):
            for cell, confidence in zip(line["cell"], line["confidence"], strict=True):
                epoch, before = known.get(cell, (line["epoch"], 0))
                if line["epoch"] > epoch and confidence < before:
                    yield robot, cell, before, confidence
                known[cell] = (line["epoch"], confidence)


def healthy_robots_are_served(e: Evidence) -> list[str]:
    """12: while another is at fault, 99 % of a healthy robot's cells are acknowledged within 2 s."""
    heal = e.heal
    if heal is None or not e.healthy:
        return []
    begin = min(a.at for a in e.actions)
    found = latencies_s(e, e.healthy, lambda at: begin <= at <= heal.at)
    p99 = float(np.percentile(found, 99)) if found else 0.0
    return [f"12: healthy robots waited {p99:.1f} s (p99 of {len(found)} cells)"] if p99 > LATENCY_MAX_S else []


CHECKERS: tuple[Callable[[Evidence], list[str]], ...] = (
    mission_ended, acknowledged_is_kept, copies_are_equal, registers_are_own_evidence, map_is_the_fold,
    versions_never_go_back, nothing_uncommitted_is_visible, queues_are_bounded, recovery_is_repeatable,
    rejected_is_explained, fencings_are_explained, confidence_survives_restart, healthy_robots_are_served,
)  # fmt: skip


def violations(evidence: Evidence) -> Iterator[str]:
    """What the checkers find wrong, one after the other."""
    for checker in CHECKERS:
        yield from checker(evidence)
