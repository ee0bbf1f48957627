"""The fold of one cell told step by step: whose registers made it, when, and what decided (mapping.md section 5).

It takes the very steps of `fold_kernels`, so what it tells is what the map holds.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from orograph.arrays import I64
from orograph.layers import CONFIDENCE, UNKNOWN_HEIGHT
from orograph.messages import Packed
from orograph.protocol import fold_kernels as kernels
from orograph.protocol.fold import AGEING
from orograph.protocol.fold_kernels import Cell, Ground
from orograph.registers import numbers
from orograph.rules import Rules, WholeRules

ONE = kernels.ONE
PRIOR = 0
"""Stands where a robot's number would."""


@dataclass(frozen=True, eq=False)
class Step:
    """One contribution and what became of the cell by it."""

    robot: int
    """Its number, PRIOR for the prior."""
    epoch: int
    seq: int
    tick_ms: int
    """Simulation time of the newest scan in it."""
    said: I64
    """Whole numbers (WIDTH,) as they were received."""
    weight: float
    """Its confidence in the ground as aged, or what is left of the prior's; 0 counts for nothing."""
    top_weight: float
    """The same of what stands on the ground; by rules of one surface always 0."""
    similar: bool | None
    """Whether its ground counted as the same surface (mapping.md 3.1); None where there was nothing to compare."""
    decided: str
    """The rule that decided on the ground."""
    bars: str
    """`barred`, `doubtful` or `by slope`: what all up to this say of driving; by rules of one surface nothing."""
    held: I64
    """The cell (WIDTH,) after it, without what comes later."""


@dataclass(frozen=True, eq=False)
class Explanation:
    """How a cell of the map came about."""

    cell: int
    steps: tuple[Step, ...]
    """In order of folding: the prior first by rules of one surface, last by those of two."""
    result: I64
    """Whole numbers (WIDTH,) as the map has them."""


def explain(prior: Packed, registers: Packed, rules: Rules) -> Explanation:
    """How the prior of a cell (UPDATE, no axes) and its ROBOT_REGISTERs (m,), in any order, make it.

    Registers without confidence are no contributions.
    """
    told, whole = _cell(numbers(prior)), rules.whole()
    some = registers[(registers["confidence"] > 0) | (registers["confidence_top"] > 0)]
    some = some[np.lexsort((some["robot"], some["tick"]))]
    way = _one_surface if not whole.two_surfaces else _two_surfaces
    steps, result = way(told, some, whole)
    return Explanation(int(prior["cell"]), tuple(steps), _whole(result))


def _cell(whole: I64) -> Cell:
    values = whole.tolist()
    return Cell(Ground(*values[:CONFIDENCE]), *values[CONFIDENCE:])


def _whole(cell: Cell) -> I64:
    return np.array([*cell.ground, *cell[1:]])


def _one_surface(told: Cell, registers: Packed, rules: WholeRules) -> tuple[list[Step], Cell]:
    held, confidence = told.ground, told.confidence * ONE
    shown = Cell(held, told.confidence, UNKNOWN_HEIGHT, 0, 0, 0)
    steps = [_step(None, told, confidence, 0, (None, "does not age"), "", shown)]
    for register in registers:
        new = _cell(numbers(register))
        weight = _aged(new.confidence, register, registers, rules)
        verdict = _verdict(held, confidence, new.ground, weight, rules)
        held, confidence = kernels.fuse_ground(held, confidence, new.ground, weight, rules)
        shown = shown._replace(ground=held, confidence=kernels.rounded(confidence))
        steps.append(_step(register, new, weight, 0, verdict, "", shown))
    return steps, shown


def _two_surfaces(told: Cell, registers: Packed, rules: WholeRules) -> tuple[list[Step], Cell]:
    so_far, steps = kernels.begin_surfaces(told), list[Step]()
    for register in registers:
        new = _cell(numbers(register))
        weight, top_weight = (_aged(c, register, registers, rules) for c in (new.confidence, new.confidence_top))
        verdict = _verdict(so_far.ground, so_far.confidence, new.ground, weight, rules)
        so_far = kernels.fuse_surfaces(so_far, new, weight, top_weight, rules)
        steps.append(_step(register, new, weight, top_weight, verdict, _bars(so_far), _shown(so_far)))
    left = max(0, told.confidence * ONE - so_far.confidence)
    top_left = 0 if so_far.cleared else max(0, told.confidence_top * ONE - so_far.top)
    verdict = _verdict(so_far.ground, so_far.confidence, told.ground, left, rules)
    held = kernels.end_surfaces(so_far, told, rules)
    steps.append(_step(None, told, left, top_left, verdict, _bars(so_far), held))
    return steps, held


def _aged(confidence: int, register: np.void, among: Packed, rules: WholeRules) -> int:
    age_ms = int(among["tick"].max()) - int(register["tick"])
    return int(kernels.aged(confidence, age_ms, rules.half_life_ms, AGEING))


def _verdict(held: Ground, confidence: int, new: Ground, weight: int, rules: WholeRules) -> tuple[bool | None, str]:
    """Whether two grounds are similar, and the rule by which they become one."""
    if weight == 0:
        return None, "of no weight"
    if confidence == 0:
        return None, "the first"
    if kernels.similar(held, new, rules):
        return True, "mean by confidence"
    differs = (weight if rules.printed else abs(weight - confidence)) > kernels.HIGH_DIFFERENCE
    if not differs and min(weight, confidence) >= kernels.HIGH_CONFIDENCE:
        return False, "both sure: the newer"
    taken = kernels.newer_wins(confidence, weight, rules.printed)
    much = "much " if differs else ""
    return False, f"{much}surer, taken" if weight > confidence else "as sure, newer" if taken else f"{much}less sure"


def _bars(so_far: kernels.Folding) -> str:
    return "barred" if so_far.barred else "doubtful" if so_far.doubtful else "by slope"


def _shown(so_far: kernels.Folding) -> Cell:
    """The cell so far, without the prior."""
    top = kernels.rounded(so_far.top)
    return Cell(
        so_far.ground._replace(occupation=so_far.occupation), kernels.rounded(so_far.confidence),
        so_far.height_top if so_far.top else UNKNOWN_HEIGHT, top, so_far.wall_share, so_far.free_share,
    )  # fmt: skip


def _step(
    register: np.void | None, said: Cell, weight: int, top_weight: int, verdict: tuple[bool | None, str], bars: str,
    held: Cell,
) -> Step:  # fmt: skip
    robot, epoch, seq, tick = (0 if register is None else int(register[n]) for n in ("robot", "epoch", "seq", "tick"))
    weights = weight / ONE, top_weight / ONE
    return Step(robot, epoch, seq, tick, _whole(said), *weights, *verdict, bars, _whole(held))
