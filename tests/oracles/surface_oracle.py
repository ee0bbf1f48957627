"""The rule set `surface` once more, from docs/mapping.md section 7: plain Python, fractions, sets of contributions."""

from __future__ import annotations

from collections.abc import Sequence
from fractions import Fraction
from typing import Any

import numpy as np
from oracles.fold_oracle import UNKNOWN_OCCUPATION, UNKNOWN_SLOPE, aged, fold_cell, half_away, similar
from orograph.rules import Rules

NO_TOP = -(2**31)
NAMES = ("height", "gradient_x", "gradient_y", "occupation", "confidence", "height_top", "confidence_top", "wall_share",
         "free_share")  # fmt: skip


def known_mean(pairs: Sequence[tuple[int, Fraction]], unknown: int | None) -> int:
    """Weighted mean of (value, weight), those of the unknown left out; the unknown where none is left."""
    left = [(value, weight) for value, weight in pairs if value != unknown]
    if len(left) < 2:
        return left[0][0] if left else int(unknown or 0)
    return half_away(Fraction(sum(v * w for v, w in left)) / sum(w for _, w in left))


def ground(held: dict[str, Any] | None, new: dict[str, Any], rules: Any) -> dict[str, Any] | None:
    """Section 3 on height and slopes; a cell is a dictionary of these and its confidence `c`."""
    if new["c"] == 0:
        return held
    if held is None:
        return new
    if similar(held, new, rules):
        pairs = {
            name: [(held[name], held["c"]), (new[name], new["c"])] for name in ("height", "gradient_x", "gradient_y")
        }
        slopes = {name: known_mean(pairs[name], UNKNOWN_SLOPE) for name in ("gradient_x", "gradient_y")}
        return {"height": known_mean(pairs["height"], None), **slopes, "c": min(Fraction(255), held["c"] + new["c"])}
    limit = Fraction(2 * 255, 16)
    large = new["c"] > limit if rules.printed else abs(new["c"] - held["c"]) > limit
    if not large and new["c"] >= 128 and held["c"] >= 128:
        return new
    return held if held["c"] > new["c"] else new


def fold_surfaces(prior: np.void, registers: Sequence[np.void], rules: Any) -> tuple[int, ...]:
    """All nine numbers of one cell from its registers (ROBOT_REGISTER)."""
    told = {name: int(prior[name]) for name in NAMES}
    some = [r for r in registers if r["confidence"] > 0 or r["confidence_top"] > 0]
    newest = max((int(r["tick"]) for r in some), default=0)
    surface: dict[str, Any] | None = None
    tops: list[tuple[int, Fraction]] = []
    shares: list[tuple[int, int, Fraction]] = []
    slopes: list[tuple[int, Fraction]] = []
    doubtful = False
    barred, cleared, open_once = told["wall_share"] > 0 and told["occupation"] == 254, False, False
    for register in sorted(some, key=lambda r: (int(r["tick"]), int(r["robot"]))):
        new = {name: int(register[name]) for name in NAMES}
        age_ms = newest - int(register["tick"])
        c, c_top = (aged(Fraction(new[name]), age_ms, rules.half_life_ms) for name in ("confidence", "confidence_top"))
        if c == 0 and c_top == 0:
            continue
        surface = ground(surface, {**new, "c": c}, rules)
        shares.append((new["wall_share"], new["free_share"], max(c, c_top)))
        walls, free = Fraction(new["wall_share"], 200), Fraction(new["free_share"], 200)
        rim = walls if walls <= Fraction(1, 10) else 0
        is_open = free + rim / 2 > Fraction(6, 10) or (walls == 0 and free >= Fraction(1, 4))
        sure = new["confidence_top"] >= 64
        shows = not is_open and walls > 0 and (sure or walls > Fraction(6, 100))
        barred = not is_open and (barred or (shows and sure and walls + free >= Fraction(1, 2)))
        doubtful = not is_open and (doubtful or shows)
        if not shows:
            slopes, open_once = [*slopes, (new["occupation"], c)], True
        if is_open and walls == 0:
            tops, cleared = [], True
        elif c_top > 0:
            tops, cleared = [*tops, (new["height_top"], c_top)], False
    left = told["confidence"] - (surface["c"] if surface else 0)
    if left > 0:
        surface = ground(surface, {**told, "c": Fraction(left)}, rules)
    surface = surface or {**told, "c": Fraction(0)}
    top, c_top = max((t for t, _ in tops), default=NO_TOP), min(Fraction(255), sum((w for _, w in tops), Fraction(0)))
    left = Fraction(0) if cleared else told["confidence_top"] - c_top
    if left > 0:
        top = told["height_top"] if not tops else known_mean([(top, c_top), (told["height_top"], left)], None)
        c_top += left
    occupation = step_mean(slopes) if open_once else told["occupation"]
    if barred:
        occupation = 254
    elif doubtful:
        occupation = 203
    elif occupation == UNKNOWN_OCCUPATION and told["occupation"] < 254:
        occupation = told["occupation"]
    wall, free = (step_mean_shares(shares, k, told[name]) for k, name in enumerate(("wall_share", "free_share")))
    return (surface["height"], surface["gradient_x"], surface["gradient_y"], occupation, half_away(surface["c"]), top,
            half_away(c_top), wall, free)  # fmt: skip


def step_mean(parts: Sequence[tuple[int, Fraction]]) -> int:
    """Known occupations fused one after another, as they came; without weight so far the newer one is taken."""
    value, weight = UNKNOWN_OCCUPATION, Fraction(0)
    for new, c in parts:
        if weight == 0 or value == UNKNOWN_OCCUPATION:
            value = new
        elif new != UNKNOWN_OCCUPATION:
            value = half_away((value * weight + new * c) / (weight + c))
        weight += c
    return value


def step_mean_shares(parts: Sequence[tuple[int, int, Fraction]], which: int, told: int) -> int:
    value, weight = told, Fraction(0)
    for part in parts:
        value = half_away((value * weight + part[which] * part[2]) / (weight + part[2]))
        weight += part[2]
    return value


def fold_slowly(prior: np.ndarray, registers: np.ndarray, rules: Rules) -> np.ndarray:
    """These cells of the map: the prior of each (n,) with the values that its ROBOT_REGISTERs (m,) give."""
    by_cell: dict[int, list[np.void]] = {}
    for register in registers:
        by_cell.setdefault(int(register["cell"]), []).append(register)
    out, cell_of = prior.copy(), fold_surfaces if rules.two_surfaces else fold_cell
    for i, cell in enumerate(prior["cell"].tolist()):
        values = cell_of(prior[i], by_cell.get(cell, []), rules.whole())
        for name, value in zip(NAMES, values, strict=False):
            out[name][i] = value
    return out


# --- one scan of one robot ------------------------------------------------------------------------------------------


def parted(zs: Sequence[float], weights: Sequence[float], seen_as: Sequence[int], ground_m: float | None, step_m: float,
           overhang_m: float) -> tuple[str, float | None, float | None, float]:  # fmt: skip
    """(kind, ground, top, its confidence) of one cell's points with their f(D); `ground_m` is sure held ground.

    Each point is seen as ground (0), raised (1) or unclear (2), which makes neither surface.
    """
    foot = min([*zs, *([] if ground_m is None else [ground_m])])
    points = [(z, f, it == 1 or z - foot >= step_m) for z, f, it in zip(zs, weights, seen_as, strict=True) if it != 2]
    high, low = [(z, f) for z, f, up in points if up], [z for z, _, up in points if not up]
    if any(z - foot <= overhang_m for z, _ in high):
        tops = sorted((z for z, _ in high), reverse=True)
        seen = min(len(high), 16) / 16 * sum(f for _, f in high) / len(high)
        return "step", None, tops[2] if len(tops) > 2 else tops[0], 255 * seen
    flat = max(zs) - foot < step_m and not any(seen_as)
    return "flat" if flat else "neither", sum(low) / len(low) if low else None, None, 0.0
