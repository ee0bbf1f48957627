"""The mapping rules in slow plain Python, straight from mapping.md sections 2-4 and written apart from the fast code.

A cell is a tuple (height, gradient_x, gradient_y, occupation, confidence) of floats, NaN unknown; a map is a dictionary
from (row, col) to cell that holds known cells only. Stored values are float32, as mapping.md says.
"""

from __future__ import annotations

import math
from collections import defaultdict
from dataclasses import dataclass, field

import numpy as np

Cell = tuple[float, float, float, float, float]
Place = tuple[int, int]
Cells = dict[Place, Cell]
NAN = math.nan


def stored(cell: tuple[float, ...]) -> Cell:
    height, gradient_x, gradient_y, occupation, confidence = (float(np.float32(v)) for v in cell)
    return height, gradient_x, gradient_y, occupation, confidence


# --- section 2 -------------------------------------------------------------------------------------------------------


def distance_factor(distance: float, range_max: float) -> float:
    if distance <= 0.75 * range_max:
        return 1 - 0.2 * distance / (0.75 * range_max)
    return 0.8 - 0.2 * (distance - 0.75 * range_max) / (0.20 * range_max)


def plane_slopes(points: np.ndarray, side: float) -> tuple[float, float] | None:
    """a, b of the least-squares plane by numpy's solver; None if the points cannot carry one."""
    if len(points) < 3:
        return None
    centred = points - points.mean(axis=0)
    spread = np.linalg.eigvalsh(centred[:, :2].T @ centred[:, :2] / len(points))
    if spread[0] < (side / 20) ** 2:
        return None
    rows = np.column_stack([np.ones(len(points)), centred[:, 0], centred[:, 1]])
    solution = np.linalg.lstsq(rows, centred[:, 2], rcond=None)[0]
    return float(solution[1]), float(solution[2])


def one_axis(before: float | None, own: float, after: float | None, side: float) -> float:
    if before is not None and after is not None:
        return (after - before) / (2 * side)
    if after is not None:
        return (after - own) / side
    return (own - before) / side if before is not None else NAN


def reconstruct(points, ranges_m, origin, side: float, shape, range_max: float, slope_max: float = 0.3):
    """(cells, dropped) of one scan: a map, and how many points were not finite, beyond range, outside."""
    found: dict[Place, list[tuple[float, float, float, float]]] = defaultdict(list)
    dropped = [0, 0, 0]
    for (x, y, z), distance in zip(points.tolist(), ranges_m.tolist(), strict=True):
        if not all(math.isfinite(v) for v in (x, y, z, distance)):
            dropped[0] += 1
        elif distance > range_max:
            dropped[1] += 1
        elif not (0 <= (x - origin[0]) / side < shape[1] and 0 <= (y - origin[1]) / side < shape[0]):
            dropped[2] += 1
        else:
            place = math.floor((y - origin[1]) / side), math.floor((x - origin[0]) / side)
            found[place].append((x, y, z, distance))
    heights = {place: sum(p[2] for p in inside) / len(inside) for place, inside in found.items()}
    return {p: _cell(p, inside, heights, origin, side, range_max, slope_max) for p, inside in found.items()}, dropped


def _cell(place, inside, heights, origin, side, range_max, slope_max) -> Cell:
    row, col = place
    own = heights[place]
    slopes = plane_slopes(np.array(inside)[:, :3], side)
    if slopes is None:
        slopes = (
            one_axis(heights.get((row, col - 1)), own, heights.get((row, col + 1)), side),
            one_axis(heights.get((row - 1, col)), own, heights.get((row + 1, col)), side),
        )
    quarters = {
        (math.floor((y - origin[1]) / (side / 4)), math.floor((x - origin[0]) / (side / 4))) for x, y, _, _ in inside
    }
    confidence = 255 * len(quarters) / 16 * sum(distance_factor(p[3], range_max) for p in inside) / len(inside)
    return stored((own, *slopes, occupation_of(*slopes, slope_max), confidence))


def occupation_of(gradient_x: float, gradient_y: float, slope_max: float) -> float:
    if math.isnan(gradient_x) or math.isnan(gradient_y):
        return NAN
    return min(1.0, math.hypot(gradient_x, gradient_y) / slope_max)


# --- section 3 -------------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Rules:
    half_life_s: float = math.inf
    height_gate_m: float = math.inf
    similarity_deg: float = 10.0
    printed: bool = False


def similar(old: Cell, new: Cell, rules: Rules) -> bool:
    for a, b in ((old[1], new[1]), (old[2], new[2])):
        known = not (math.isnan(a) or math.isnan(b))
        if known and math.degrees(abs(math.atan(a) - math.atan(b))) > rules.similarity_deg:
            return False
    return math.isnan(old[0] - new[0]) or abs(old[0] - new[0]) <= rules.height_gate_m


def fuse(old: Cell, new: Cell, rules: Rules, slope_max: float | None = 0.3) -> Cell:
    """Two cells whose confidences have decayed; slope_max None: occupation like height."""
    c1, c2 = old[4], new[4]
    if c1 == 0 or c2 == 0:
        return new if c1 == 0 and c2 > 0 else old
    if similar(old, new, rules):
        mean = [b if math.isnan(a) else a if math.isnan(b) else (a * c1 + b * c2) / (c1 + c2)
                for a, b in zip(old[:4], new[:4], strict=True)]  # fmt: skip
        if slope_max is not None:
            mean[3] = occupation_of(mean[1], mean[2], slope_max)
        return stored((*mean, min(255.0, c1 + c2)))
    large = c2 > 2 / 16 * 255 if rules.printed else abs(c2 - c1) > 2 / 16 * 255
    if large:
        return stored(old if c1 > c2 else new)
    if c1 >= 128 and c2 >= 128:
        return stored(new)
    return stored(old if c1 > c2 else new)


def decayed(cell: Cell, age_ms: int, rules: Rules) -> Cell:
    return (*cell[:4], cell[4] * 0.5 ** (age_ms / 1000 / rules.half_life_s))


# --- section 4 -------------------------------------------------------------------------------------------------------


def rescale(cells: Cells, factor: int) -> Cells:
    """Coarse cells of factor x factor fine ones; (row, col) may be negative."""
    blocks: dict[Place, list[Cell]] = defaultdict(list)
    for (row, col), cell in cells.items():
        blocks[row // factor, col // factor].append(cell)
    return {place: _mean(inside, factor) for place, inside in blocks.items()}


def _mean(inside: list[Cell], factor: int) -> Cell:
    means = []
    for layer in range(4):
        known = [(cell[layer], cell[4]) for cell in inside if not math.isnan(cell[layer])]
        weight = sum(c for _, c in known)
        means.append(sum(v * c for v, c in known) / weight if weight > 0 else NAN)
    return stored((*means, sum(cell[4] for cell in inside) / factor**2))


@dataclass
class Robot:
    """A robot's evidence on fine cells numbered from the GLRM's origin, in a window of blocks x blocks GLRM cells."""

    shape: tuple[int, int]
    side: float
    blocks: int
    factor: int
    rules: Rules
    range_max: float
    window: Place | None = None
    fine: dict[Place, tuple[Cell, int]] = field(default_factory=dict)
    coarse: dict[Place, tuple[Cell, int]] = field(default_factory=dict)

    def scan(self, points, ranges_m, x: float, y: float, tick_ms: int) -> set[Place]:
        """One scan; returns the GLRM cells it touched. The GLRM's origin is (0, 0)."""
        self._roll(x, y)
        row0, col0 = self.window
        origin = col0 * self.side, row0 * self.side
        cells = self.blocks * self.factor
        aux, _ = reconstruct(points, ranges_m, origin, self.side / self.factor, (cells, cells), self.range_max)
        touched = set()
        for (row, col), cell in aux.items():
            place = row + row0 * self.factor, col + col0 * self.factor
            if place in self.fine:
                old, tick = self.fine[place]
                cell = fuse(decayed(old, tick_ms - tick, self.rules), cell, self.rules)
            self.fine[place] = cell, tick_ms
            touched.add((place[0] // self.factor, place[1] // self.factor))
        inside = {p for p in touched if 0 <= p[0] < self.shape[0] and 0 <= p[1] < self.shape[1]}
        for block in inside:
            self.coarse[block] = self._block(block)
        return inside

    def _block(self, block: Place) -> tuple[Cell, int]:
        f = self.factor
        places = [(r, c) for r in range(block[0] * f, block[0] * f + f) for c in range(block[1] * f, block[1] * f + f)]
        held = {p: self.fine[p] for p in places if p in self.fine}
        means = rescale({p: cell for p, (cell, _) in held.items()}, f)
        return means[block], max(tick for _, tick in held.values())

    def _roll(self, x: float, y: float) -> None:
        half = self.blocks / 2
        if self.window is None:
            window = math.floor(y / self.side - half + 0.5), math.floor(x / self.side - half + 0.5)
            self.window = window
            return
        row, col = self.window
        while y / self.side - half - row >= 1:
            row += 1
        while y / self.side - half - row <= -1:
            row -= 1
        while x / self.side - half - col >= 1:
            col += 1
        while x / self.side - half - col <= -1:
            col -= 1
        self._move(row, col)

    def _move(self, row: int, col: int) -> None:
        def within(block: Place, corner: Place) -> bool:
            return all(0 <= b - c < self.blocks for b, c in zip(block, corner, strict=True))

        f, before, self.window = self.factor, self.window, (row, col)
        self.fine = {p: v for p, v in self.fine.items() if within((p[0] // f, p[1] // f), self.window)}
        for block, value in self.coarse.items():
            if within(block, self.window) and not within(block, before):
                for r in range(block[0] * f, block[0] * f + f):
                    for c in range(block[1] * f, block[1] * f + f):
                        self.fine[r, c] = value
