"""What a run promised, checked from what it left behind and not from what its services claimed (protocol.md, 1-3)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from orograph import keys
from orograph.messages import UPDATE, Packed
from orograph.protocol.fold import ROBOT_REGISTER, FoldRules, fold_registers, same_values, whole_prior
from orograph.protocol.tiles import map_hash
from orograph.scene.prior import prior_records
from orograph.storage.parts import RunParts


@dataclass(frozen=True)
class Check:
    """One promise: kept, broken, or None where the run left too little to tell."""

    promise: str
    ok: bool | None
    found: str


@dataclass(frozen=True, eq=False)
class Ledger:
    """Registers and copies, as robots and manager hold them at the end."""

    glrm: Packed | None
    """The manager's cells (n,), None where it left none."""
    copies: Mapping[str, Packed]
    own: Mapping[str, Packed]
    """Robot -> its own registers (m,)."""
    acked: Mapping[str, Packed]
    """Robot -> its registers in the form in which they were last acknowledged to it."""
    held: Packed
    """REGISTERs (k,) at the manager."""


def read_ledger(parts: RunParts) -> Ledger:
    """The registers and copies among the artifacts."""
    manager = parts.of(keys.MANAGER)
    robots = {robot: parts.of(keys.MAPPING, robot) for robot in parts.robots}
    return Ledger(
        glrm=manager.get("glrm"),
        copies={r: a["copy"] for r, a in robots.items() if "copy" in a},
        own={r: _live(a["registers"]) for r, a in robots.items() if "registers" in a},
        acked={r: _live(a["acknowledged"]) for r, a in robots.items() if "acknowledged" in a},
        held=manager.get("registers", np.zeros(0, ROBOT_REGISTER)),
    )


def _live(registers: Packed) -> Packed:
    """Those that hold evidence."""
    live: Packed = registers[registers["confidence"] > 0]
    return live


def lost_cells(ledger: Ledger, robot: str) -> int:
    """How many acknowledged registers of a robot the manager misses, or holds only in an older form (invariant 1).

    Older by the tick of the newest scan in it, which only grows; seqs begin anew with each epoch.
    """
    mine = ledger.held[ledger.held["robot"] == keys.robot_number(robot)]
    acked = ledger.acked.get(robot, mine[:0])
    newest = np.full(int(max(mine["cell"].max(initial=0), acked["cell"].max(initial=0))) + 1, -1, np.int64)
    newest[mine["cell"]] = mine["tick"]
    return int((newest[acked["cell"]] < acked["tick"]).sum())


def own_fold(parts: RunParts, ledger: Ledger) -> Packed:
    """The map that the robots' own last evidence gives, without the manager's help.

    Of a robot that has gone the manager may have taken more than it still heard of: its registers are the manager's.
    """
    prior = whole_prior(prior_records(parts.scenario), parts.glrm_grid.size)
    registers = [_register(robot, own) for robot, own in ledger.own.items() if robot not in parts.gone]
    left = np.isin(ledger.held["robot"], [keys.robot_number(robot) for robot in parts.gone])
    everyone = np.concatenate([ledger.held[left], *registers])
    return fold_registers(prior, everyone, FoldRules.of(parts.scenario.rules))


def _register(robot: str, own: Packed) -> npt.NDArray[Any]:
    out = np.zeros(len(own), ROBOT_REGISTER)
    out["robot"] = keys.robot_number(robot)
    for name in UPDATE.names or ():
        out[name] = own[name]
    return out


def checks(parts: RunParts, ledger: Ledger) -> list[Check]:
    """Every promise of a run, in the order in which a reader asks."""
    return [
        _ended(parts),
        _deterministic(parts),
        _copies(parts, ledger),
        _fold(parts, ledger),
        _nothing_lost(parts, ledger),
    ]


def _ended(parts: RunParts) -> Check:
    complete = bool(parts.run.get("complete"))
    found = "Patrol driven, every robot flushed." if complete else "Time was up, or a robot never flushed."
    return Check("The mission ended by itself", complete, found)


def _deterministic(parts: RunParts) -> Check:
    sure = bool(parts.run.get("deterministic"))
    found = (
        "No link was cut but by the scenario, no wait ran out."
        if sure
        else "Paced time, or a wait at the barrier ran out."
    )
    return Check("Same scenario and seed give the same map", sure, found)


def copies_equal(parts: RunParts, ledger: Ledger) -> bool | None:
    """Whether every copy of a robot that stayed has the manager's hash; None where one of them left no map."""
    return _copies(parts, ledger).ok


def _copies(parts: RunParts, ledger: Ledger) -> Check:
    if ledger.glrm is None:
        return Check("Every robot holds the manager's map", None, "The map manager left no map.")
    wanted = map_hash(ledger.glrm)
    copies = [ledger.copies[robot] for robot in parts.staying if robot in ledger.copies]
    same = sum(map_hash(copy) == wanted for copy in copies)
    found = f"{same} of {len(parts.staying)} copies have the hash {wanted.hex()[:12]}…"
    if parts.gone:
        found += f" Not there at the end: {', '.join(parts.gone)}."
    ok = None if len(copies) < len(parts.staying) else same == len(copies)
    return Check("Every robot holds the manager's map, bit for bit", ok, found)


def is_own_fold(parts: RunParts, ledger: Ledger) -> bool | None:
    """Whether the map is the fold of the robots' own last evidence; None where some of that is missing."""
    return _fold(parts, ledger).ok


def _fold(parts: RunParts, ledger: Ledger) -> Check:
    promise = "The map is the fold of the robots' own last evidence"
    if ledger.glrm is None or not set(parts.staying) <= set(ledger.own):
        return Check(promise, None, "Registers of the manager or of a robot are missing.")
    wanted, glrm = own_fold(parts, ledger), ledger.glrm
    differ = int((~same_values(wanted, glrm)).sum())
    registers = sum(len(ledger.own[robot]) for robot in parts.staying)
    found = f"{registers:,} registers folded again: " + (
        f"{differ:,} cells differ." if differ else "equal in every cell."
    )
    return Check(promise, differ == 0, found)


def _nothing_lost(parts: RunParts, ledger: Ledger) -> Check:
    promise = "Nothing that was acknowledged is lost"
    if ledger.glrm is None or not set(parts.staying) <= set(ledger.acked):
        return Check(promise, None, "Registers of the manager or of a robot are missing.")
    lost = sum(lost_cells(ledger, robot) for robot in parts.robots)
    acked = sum(len(acked) for acked in ledger.acked.values())
    return Check(promise, lost == 0, f"{acked:,} acknowledged cells, {lost:,} of them missing at the manager.")
