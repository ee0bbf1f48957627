"""The fold of one cell told step by step: whose registers made it, when, and what decided (mapping.md section 5).

It takes the very steps of `fold_kernels`, so what it tells is what the map holds.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from orograph.arrays import I64
from orograph.layers import CONFIDENCE, CONFIDENCE_TOP, HEIGHT_TOP, UNKNOWN_HEIGHT
from orograph.messages import Packed
from orograph.protocol import fold_kernels as kernels
from orograph.protocol.fold import AGEING
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
    """`barred`, `doubtful` or `by slope`: what this and those before say of driving; nothing by rules of one surface."""
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
    told, whole = numbers(prior), rules.whole()
    some = registers[(registers["confidence"] > 0) | (registers["confidence_top"] > 0)]
    some = some[np.lexsort((some["robot"], some["tick"]))]
    way = _one_surface if not whole.two_surfaces else _two_surfaces
    steps, result = way(told, some, whole)
    return Explanation(int(prior["cell"]), tuple(steps), result)


def _one_surface(told: I64, registers: Packed, rules: WholeRules) -> tuple[list[Step], I64]:
    held, confidence = told.copy(), int(told[CONFIDENCE]) * ONE
    steps = [_step(None, told, confidence, 0, (None, "does not age"), "", held)]
    for register in registers:
        new = numbers(register)
        weight = _aged(new[CONFIDENCE], register, registers, rules)
        verdict = _verdict(held, confidence, new, weight, rules)
        confidence = kernels.fuse_cell(held, confidence, new, weight, rules)
        held[CONFIDENCE] = _rounded(confidence)
        steps.append(_step(register, new, weight, 0, verdict, "", held))
    return steps, held


def _two_surfaces(told: I64, registers: Packed, rules: WholeRules) -> tuple[list[Step], I64]:
    held, so_far, steps = told.copy(), kernels.begin_surfaces(told), list[Step]()
    for register in registers:
        new = numbers(register)
        weight, top_weight = (_aged(new[k], register, registers, rules) for k in (CONFIDENCE, CONFIDENCE_TOP))
        verdict = _verdict(held, so_far.ground, new, weight, rules)
        so_far = kernels.fuse_surfaces(held, so_far, new, weight, top_weight, rules)
        steps.append(_step(register, new, weight, top_weight, verdict, _bars(so_far), _shown(held, so_far)))
    left = max(0, int(told[CONFIDENCE]) * ONE - so_far.ground)
    top_left = 0 if so_far.cleared else max(0, int(told[CONFIDENCE_TOP]) * ONE - so_far.top)
    verdict = _verdict(held, so_far.ground, told, left, rules)
    kernels.end_surfaces(held, so_far, told, rules)
    steps.append(_step(None, told, left, top_left, verdict, _bars(so_far), held))
    return steps, held


def _aged(confidence: int, register: np.void, among: Packed, rules: WholeRules) -> int:
    age_ms = int(among["tick"].max()) - int(register["tick"])
    return int(kernels.aged(confidence, age_ms, rules.half_life_ms, AGEING))


def _verdict(held: I64, confidence: int, new: I64, weight: int, rules: WholeRules) -> tuple[bool | None, str]:
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


def _shown(held: I64, so_far: kernels.Folding) -> I64:
    """The cell so far: its confidences stand in `so_far` until the fold ends."""
    shown = held.copy()
    shown[CONFIDENCE], shown[CONFIDENCE_TOP] = _rounded(so_far.ground), _rounded(so_far.top)
    if so_far.top == 0:
        shown[HEIGHT_TOP] = UNKNOWN_HEIGHT
    return shown


def _rounded(confidence: int) -> int:
    return (confidence + ONE // 2) // ONE


def _step(
    register: np.void | None, said: I64, weight: int, top_weight: int, verdict: tuple[bool | None, str], bars: str,
    held: I64,
) -> Step:  # fmt: skip
    robot, epoch, seq, tick = (0 if register is None else int(register[n]) for n in ("robot", "epoch", "seq", "tick"))
    return Step(robot, epoch, seq, tick, said, weight / ONE, top_weight / ONE, *verdict, bars, held.copy())
