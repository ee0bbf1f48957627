"""What a run promised, checked from what it left behind and not from what its services claimed (protocol.md, 1-3)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from orograph import keys
from orograph.grid import Grid
from orograph.judge import invariants
from orograph.messages import ROBOT_REGISTER, Packed
from orograph.protocol.fold import fold_registers, whole_prior
from orograph.protocol.tiles import map_hash
from orograph.registers import has_evidence, of_robot
from orograph.rules import Rules
from orograph.storage.parts import RunParts
from orograph.storage.results import Contact, SurfaceChange


@dataclass(frozen=True)
class Check:
    """One promise: kept, broken, or None where the run left too little to tell."""

    promise: str
    ok: bool | None
    found: str


class Checks(NamedTuple):
    """Every promise of a run, in the order in which a reader asks."""

    complete: Check
    no_contacts: Check
    deterministic: Check
    copies_equal: Check
    is_own_fold: Check
    nothing_lost: Check


@dataclass(frozen=True, eq=False)
class Ledger:
    """Registers and copies, as robots and manager hold them at the end."""

    glrm: Packed | None
    """The manager's cells (n,), None where it left none."""
    copied: Packed | None
    """The same at the end of the run: other cells where a robot was revoked after it."""
    copies: Mapping[str, Packed]
    own: Mapping[str, Packed]
    """Robot -> its own registers (m,), ROBOT_REGISTER without an epoch."""
    acked: Mapping[str, Packed]
    """Robot -> its registers in the form in which they were last acknowledged to it, without an epoch.

    Not of those that were revoked: what they lost is no loss.
    """
    held: Packed
    """ROBOT_REGISTERs (k,) at the manager."""


def read_ledger(parts: RunParts) -> Ledger:
    """The registers and copies among the artifacts."""
    manager = parts.of(keys.MANAGER)
    robots = {robot: parts.of(keys.MAPPING, robot) for robot in parts.robots}
    return Ledger(
        glrm=manager.get("glrm"),
        copied=manager.get("glrm_at_end", manager.get("glrm")),
        copies={r: a["copy"] for r, a in robots.items() if "copy" in a},
        own={r: _registers(r, a["registers"]) for r, a in robots.items() if "registers" in a},
        acked={
            r: _registers(r, a["acknowledged"])
            for r, a in robots.items()
            if "acknowledged" in a and r not in parts.revoked
        },
        held=manager.get("registers", np.zeros(0, ROBOT_REGISTER)),
    )


def _registers(robot: str, updates: Packed) -> Packed:
    """Those of a robot's UPDATEs that hold evidence."""
    live = updates[has_evidence(updates)]
    return of_robot(keys.robot_number(robot), live)


def lost_cells(ledger: Ledger, robot: str) -> int:
    """How many acknowledged registers of a robot the manager misses, or holds only in an older form.

    Older by the tick of the newest scan in it, which only grows; seqs begin anew with each epoch.
    """
    return len(invariants.registers_kept(ledger.acked[robot], ledger.held, by=("tick",)))


def own_fold(parts: RunParts, ledger: Ledger, prior: Packed) -> Packed:
    """The map that the robots' own last evidence gives over the prior UPDATEs (n,), without the manager's help.

    Of a robot that has gone the manager may have taken more than it still heard of: its registers are the manager's.
    """
    staying = [own for robot, own in ledger.own.items() if robot in parts.staying]
    left = np.isin(ledger.held["robot"], [keys.robot_number(robot) for robot in parts.gone])
    everyone = np.concatenate([ledger.held[left], *staying])
    return fold_registers(whole_prior(prior, parts.glrm_grid.size), everyone, Rules.of(parts.scenario.rules))


def checks(parts: RunParts, ledger: Ledger, prior: Packed) -> Checks:
    """Every promise of a run that began with the prior UPDATEs (n,)."""
    return Checks(
        _complete(parts), _no_contacts(parts), _deterministic(parts), _copies(parts, ledger),
        _fold(parts, ledger, prior), _nothing_lost(parts, ledger),
    )  # fmt: skip


def waypoints_missed(parts: RunParts) -> tuple[int, ...] | None:
    """Places in the patrol that nobody visited; None where the orchestrator left nothing."""
    visited_ns = parts.of(keys.ORCHESTRATOR).get("visited_ns")
    return None if visited_ns is None else tuple(np.flatnonzero(visited_ns < 0).tolist())


def contacts(parts: RunParts) -> tuple[Contact, ...]:
    """Collisions of robots, in the order of their ends."""
    named = Contact.model_fields
    return tuple(Contact(**{k: event[k] for k in named}) for event in parts.events if event.get("event") == "contact")


def surface_changes(parts: RunParts) -> tuple[SurfaceChange, ...]:
    """What the map manager saw change, in the order of its telling."""
    told = (event for event in parts.events if event.get("event") == "changed")
    return tuple(_surface_change(parts.glrm_grid, event) for event in told)


def _surface_change(grid: Grid, event: Mapping[str, Any]) -> SurfaceChange:
    row, col = divmod(int(event["cell"]), grid.cols)
    x_m, y_m = grid.centre_m(row, col)
    return SurfaceChange(
        row=row, col=col, x_m=x_m, y_m=y_m, since_s=event["since_ms"] / 1e3, told_s=event["stamp_ns"] / 1e9,
        from_top_m=event["from_top_m"], to_top_m=event["to_top_m"],
    )  # fmt: skip


def _complete(parts: RunParts) -> Check:
    missed, patrol = waypoints_missed(parts), len(parts.scenario.patrol)
    if parts.run.complete:
        found = f"All {patrol} waypoints visited, every robot flushed."
    elif missed:
        found = f"Not visited: waypoint{'s' * (len(missed) > 1)} {', '.join(map(str, missed))} of 0 to {patrol - 1}."
    else:
        found = "A robot never flushed."
    return Check("The mission is complete", parts.run.complete, found)


def _no_contacts(parts: RunParts) -> Check:
    met = contacts(parts)
    worst = max(met, key=lambda contact: contact.newtons, default=None)
    found = "No robot was pushed by anything."
    if worst is not None:
        found = (f"{len(met)} collision{'s' * (len(met) > 1)}; the hardest: {worst.robot} and {worst.body} "
                 f"after {worst.since_s:.1f} s, {worst.newtons:,.0f} N for {worst.seconds:.1f} s.")  # fmt: skip
    return Check("No robot hit anything", not met, found)


def _deterministic(parts: RunParts) -> Check:
    promise = "Same scenario and seed give the same map"
    if parts.revoked:
        return Check(promise, False, f"Revoked by hand: {', '.join(parts.revoked)}.")
    if parts.run.deterministic:
        return Check(promise, True, "Everybody kept step to the end; no message was lost but by the scenario.")
    if parts.run.mode == "paced":
        return Check(promise, False, "Paced time: what comes late depends on the machine.")
    return Check(promise, False, "A worker died or came late, a message was lost, or the run was stopped.")


def _copies(parts: RunParts, ledger: Ledger) -> Check:
    if ledger.copied is None:
        return Check("Every robot holds the manager's map", None, "The map manager left no map.")
    wanted = map_hash(ledger.copied)
    copies = {robot: map_hash(ledger.copies[robot]) for robot in parts.staying if robot in ledger.copies}
    same = len(copies) - len(invariants.copies_equal(copies, wanted))
    found = f"{same} of {len(parts.staying)} copies have the hash {wanted.hex()[:12]}…"
    if parts.gone:
        found += f" Not there at the end: {', '.join(parts.gone)}."
    if parts.revoked:
        found += f" Revoked: {', '.join(parts.revoked)}."
    ok = None if len(copies) < len(parts.staying) else same == len(copies)
    return Check("Every robot holds the manager's map, bit for bit", ok, found)


def _fold(parts: RunParts, ledger: Ledger, prior: Packed) -> Check:
    promise = "The map is the fold of the robots' own last evidence"
    if ledger.glrm is None or not set(parts.staying) <= set(ledger.own):
        return Check(promise, None, "Registers of the manager or of a robot are missing.")
    differ = len(invariants.map_is_fold(ledger.glrm, own_fold(parts, ledger, prior)))
    registers = sum(len(ledger.own[robot]) for robot in parts.staying)
    found = f"{registers:,} registers folded again: " + (
        f"{differ:,} cells differ." if differ else "equal in every cell."
    )
    return Check(promise, differ == 0, found)


def _nothing_lost(parts: RunParts, ledger: Ledger) -> Check:
    promise = "Nothing that was acknowledged is lost"
    if ledger.glrm is None or not set(parts.staying) <= set(ledger.acked):
        return Check(promise, None, "Registers of the manager or of a robot are missing.")
    lost = sum(lost_cells(ledger, robot) for robot in ledger.acked)
    acked = sum(len(acked) for acked in ledger.acked.values())
    return Check(promise, lost == 0, f"{acked:,} acknowledged cells, {lost:,} of them missing at the manager.")
