"""A made-up town: streets on a jittered grid and blocks of several kinds between them, drawn from one generator."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import shapely

from orograph.arrays import F64

PITCH_M = (90.0, 75.0)
"""Between crossings, east and north."""
JITTER_M = 5.0
"""Farthest that a crossing lies off the grid, along each axis."""
EDGE_M = 15.0
"""From the outermost crossings' grid to the map's edge."""
KERB_M = 7.5
"""From a street's centre line to the fronts: streets are 15 m wide."""
LANE_M = 4.0
"""From the centre line to where vehicles drive, so that a robot in the middle has room."""
BLOCKS_MIN = (2, 2)

Part = tuple[float, float, float, float, float, float, str]
"""Of a block, in shares of its sides: west, south, east, north; lowest and greatest height [m]; roof."""
KINDS: tuple[tuple[Part, ...], ...] = (
    # perimeter block, its yard open to the north; hall and office; terraces; villas; towers; park with a pavilion
    ((0, 0, 1, 0.25, 9, 14, "flat"), (0, 0.25, 0.2, 1, 9, 14, "flat"), (0.8, 0.25, 1, 1, 9, 14, "flat")),
    ((0, 0, 1, 0.55, 6, 8, "flat"), (0, 0.75, 0.45, 1, 10, 14, "flat")),
    tuple((k / 5, v, (k + 1) / 5, v + 0.3, 6, 9, "gable") for v in (0.0, 0.7) for k in range(5)),
    tuple((u, v, u + 0.2, v + 0.25, 5, 8, "hip") for u in (0.0, 0.4, 0.8) for v in (0.05, 0.7)),
    ((0, 0, 0.3, 0.4, 14, 24, "flat"), (0.6, 0, 1, 0.35, 14, 24, "flat"), (0.3, 0.65, 0.7, 1, 14, 24, "flat")),
    ((0.4, 0.4, 0.6, 0.6, 3, 5, "hip"),),
)
ROOF_SHARE = 0.4
"""Of a house's height, under gables and hips."""


@dataclass(frozen=True)
class Town:
    """Crossings (rows + 1, cols + 1, 2) [m] from the south-west one on, each joined to the next by a street."""

    crossings: F64

    @property
    def size_m(self) -> tuple[float, float]:
        """East and north sides of the map, whose origin is its south-west corner."""
        rows, cols = self.crossings.shape[0] - 1, self.crossings.shape[1] - 1
        return cols * PITCH_M[0] + 2 * EDGE_M, rows * PITCH_M[1] + 2 * EDGE_M

    @property
    def streets(self) -> list[shapely.LineString]:
        """One from each crossing to the next, east or north."""
        at = self.crossings
        pairs = [np.stack([at[:, :-1], at[:, 1:]], axis=2), np.stack([at[:-1], at[1:]], axis=2)]
        return [shapely.LineString(ends) for ends in np.concatenate([p.reshape(-1, 2, 2) for p in pairs])]

    def blocks(self, inset_m: float) -> list[F64]:
        """Corners (4, 2) [m], from the south-west counter-clockwise, so far inside of the centre lines round each."""
        at = self.crossings
        corners = np.stack([at[:-1, :-1], at[:-1, 1:], at[1:, 1:], at[1:, :-1]], axis=2).reshape(-1, 4, 2)
        return [_inset(block, inset_m) for block in corners]


def town(street_m: float, random: np.random.Generator) -> Town:
    """The smallest, nearly square one with streets of this length before their crossings are moved."""
    cols, rows = BLOCKS_MIN
    while (rows + 1) * cols * PITCH_M[0] + rows * (cols + 1) * PITCH_M[1] < street_m:
        cols, rows = (cols + 1, rows) if cols * PITCH_M[0] <= rows * PITCH_M[1] else (cols, rows + 1)
    x_m, y_m = np.meshgrid(np.arange(cols + 1) * PITCH_M[0] + EDGE_M, np.arange(rows + 1) * PITCH_M[1] + EDGE_M)
    at = np.stack([x_m, y_m], axis=-1)
    return Town((at + random.uniform(-JITTER_M, JITTER_M, at.shape)).round(1))


def houses(town: Town, random: np.random.Generator) -> list[dict[str, Any]]:
    """Its buildings as a scenario spells them: every kind of block in turn, in a drawn order."""
    blocks = town.blocks(KERB_M)
    kinds = random.permutation(np.arange(len(blocks)) % len(KINDS)).tolist()
    return [_house(block, part, random) for block, kind in zip(blocks, kinds, strict=True) for part in KINDS[kind]]


def _house(block: F64, part: Part, random: np.random.Generator) -> dict[str, Any]:
    *sides, lowest_m, greatest_m, roof = part
    height_m = round(float(random.uniform(lowest_m, greatest_m)), 1)
    place = block if roof == "flat" else _rectangle(block)
    house: dict[str, Any] = {"footprint": _within(place, *sides).round(2).tolist(), "height_m": height_m}
    return house if roof == "flat" else {**house, "roof": roof, "roof_height_m": round(ROOF_SHARE * height_m, 1)}


def _within(corners: F64, west: float, south: float, east: float, north: float) -> F64:
    """The part (4, 2) of a four-sided block, its sides given in shares: fronts run along streets."""
    u, v = np.array([west, east, east, west])[:, None], np.array([south, south, north, north])[:, None]
    low, high = corners[0] + u * (corners[1] - corners[0]), corners[3] + u * (corners[2] - corners[3])
    part: F64 = low + v * (high - low)
    return part


def _rectangle(corners: F64) -> F64:
    """The rectangle (4, 2) along the axes within a block, as ridged roofs need one."""
    (sw, se, ne, nw) = corners
    x0, x1, y0, y1 = max(sw[0], nw[0]), min(se[0], ne[0]), max(sw[1], se[1]), min(nw[1], ne[1])
    return np.array([[x0, y0], [x1, y0], [x1, y1], [x0, y1]])


def _inset(corners: F64, by_m: float) -> F64:
    ring = shapely.get_coordinates(shapely.Polygon(corners).buffer(-by_m, join_style="mitre"))[:-1]
    apart_m = np.linalg.norm(corners[:, None] - ring, axis=2)
    nearest: F64 = ring[np.argmin(apart_m, axis=1)]
    return nearest
