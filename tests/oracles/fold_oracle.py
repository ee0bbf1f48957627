"""The fold once more, straight from mapping.md sections 3 and 5: plain Python, fractions, no table of ours."""

from __future__ import annotations

from collections.abc import Sequence
from decimal import Decimal, getcontext
from fractions import Fraction
from functools import cache
from typing import Any

import numpy as np

getcontext().prec = 60
UNKNOWN_SLOPE, UNKNOWN_OCCUPATION = -32768, 255
STEPS = 256


def half_away(x: Fraction) -> int:
    size = (abs(x) + Fraction(1, 2)).__floor__()
    return size if x >= 0 else -size


@cache
def ageing(step: int) -> int:
    """round(2^16 * 2^(-step / 256)) by decimals of 60 digits."""
    exact = Decimal(2) ** (Decimal(16) - Decimal(step) / STEPS)
    return int((exact + Decimal("0.5")).to_integral_value(rounding="ROUND_FLOOR"))


def aged(confidence: Fraction, age_ms: int, half_life_ms: int) -> Fraction:
    if half_life_ms == 0 or age_ms == 0:
        return confidence
    halvings, step = divmod(age_ms * STEPS // half_life_ms, STEPS)
    if halvings > 30:
        return Fraction(0)
    exact = confidence * STEPS * ageing(step) / (Fraction(2) ** (16 + halvings))
    return Fraction(half_away(exact), STEPS)


def similar(a: dict[str, Any], b: dict[str, Any], rules: Any) -> bool:
    if rules.height_gate_mm >= 0 and abs(a["height"] - b["height"]) > rules.height_gate_mm:
        return False
    for name in ("gradient_x", "gradient_y"):
        if UNKNOWN_SLOPE in (a[name], b[name]):
            continue
        s, t = Fraction(a[name], 10_000), Fraction(b[name], 10_000)
        if 1 + s * t <= 0 or abs(s - t) / (1 + s * t) > Fraction(rules.similar_n, rules.similar_d):
            return False
    return True


def mean(a: dict[str, Any], b: dict[str, Any], name: str, unknown: int | None) -> int:
    if unknown is not None and a[name] == unknown:
        return int(b[name])
    if unknown is not None and b[name] == unknown:
        return int(a[name])
    return half_away((a[name] * a["c"] + b[name] * b["c"]) / (a["c"] + b["c"]))


def fuse(old: dict[str, Any], new: dict[str, Any], rules: Any) -> dict[str, Any]:
    if new["c"] == 0:
        return old
    if old["c"] == 0:
        return new
    if similar(old, new, rules):
        unknown = {
            "height": None,
            "gradient_x": UNKNOWN_SLOPE,
            "gradient_y": UNKNOWN_SLOPE,
            "occupation": UNKNOWN_OCCUPATION,
        }
        fused: dict[str, Any] = {name: mean(old, new, name, mark) for name, mark in unknown.items()}
        fused["c"] = min(Fraction(255), old["c"] + new["c"])
        return fused
    limit = Fraction(2 * 255, 16)
    high_difference = new["c"] > limit if rules.printed else abs(new["c"] - old["c"]) > limit
    if not high_difference and new["c"] >= 128 and old["c"] >= 128:
        return new
    return old if old["c"] > new["c"] else new


def cell_of(record: np.void) -> dict[str, Any]:
    values = {name: int(record[name]) for name in ("height", "gradient_x", "gradient_y", "occupation")}
    return {**values, "c": Fraction(int(record["confidence"]))}


def fold_cell(prior: np.void, registers: Sequence[np.void], rules: Any) -> tuple[int, ...]:
    """(height, gradient_x, gradient_y, occupation, confidence) of one cell from its registers (ROBOT_REGISTER)."""
    cell = cell_of(prior)
    contributions = [r for r in registers if r["confidence"] > 0]
    newest = max((int(r["tick"]) for r in contributions), default=0)
    for register in sorted(contributions, key=lambda r: (int(r["tick"]), int(r["robot"]))):
        new = cell_of(register)
        new["c"] = aged(new["c"], newest - int(register["tick"]), rules.half_life_ms)
        cell = fuse(cell, new, rules)
    return (*(cell[name] for name in ("height", "gradient_x", "gradient_y", "occupation")), half_away(cell["c"]))
