"""Loops that vehicles drive: closed polylines with rounded corners, measured by length."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from orograph.arrays import F64
from orograph.scenario import PointM

CORNER_RADIUS_M = 5.0
ARC_STEP_RAD = math.radians(5.0)


@dataclass(frozen=True, eq=False)
class Loop:
    """A closed path: points (n, 2), heading (n,) unwrapped, distance (n,) [m]; the last point is the first again."""

    points: F64
    heading_rad: F64
    distance_m: F64

    @property
    def length_m(self) -> float:
        """Once around."""
        return float(self.distance_m[-1])

    def at(self, distance_m: float) -> tuple[float, float, float]:
        """(x, y, heading in [-pi, pi)) at a distance along the loop, any number of rounds."""
        along = distance_m % self.length_m
        x, y, heading = (
            float(np.interp(along, self.distance_m, values))
            for values in (self.points[:, 0], self.points[:, 1], self.heading_rad)
        )
        return x, y, (heading + math.pi) % (2 * math.pi) - math.pi


def _corner(before: F64, corner: F64, after: F64) -> Iterator[tuple[float, float, float]]:
    """Points (x, y, heading) of the arc that rounds one corner, tangent to both edges."""
    edge_in, edge_out = corner - before, after - corner
    length_in, length_out = math.hypot(*edge_in), math.hypot(*edge_out)
    heading_in = math.atan2(edge_in[1], edge_in[0])
    turn = (math.atan2(edge_out[1], edge_out[0]) - heading_in + math.pi) % (2 * math.pi) - math.pi
    half_tangent = math.tan(min(abs(turn), math.radians(175)) / 2)
    cut_m = min(CORNER_RADIUS_M * half_tangent, 0.5 * length_in, 0.5 * length_out)
    radius_m = cut_m / half_tangent if half_tangent > 0 else 0.0
    x, y = corner - edge_in / length_in * cut_m
    side = math.copysign(1.0, turn)
    centre_x, centre_y = x - side * radius_m * math.sin(heading_in), y + side * radius_m * math.cos(heading_in)
    for heading in np.linspace(heading_in, heading_in + turn, max(2, math.ceil(abs(turn) / ARC_STEP_RAD) + 1)):
        yield (
            centre_x + side * radius_m * math.sin(heading),
            centre_y - side * radius_m * math.cos(heading),
            float(heading),
        )


def rounded_loop(corners_m: tuple[PointM, ...]) -> Loop:
    """The loop through these corners, which an arc of 5 m radius (less on short edges) cuts off.

    It starts where the first corner's arc begins. Raises ValueError where two following corners coincide.
    """
    corners = np.array(corners_m, np.float64)
    if (np.hypot(*(corners - np.roll(corners, 1, axis=0)).T) < 1e-6).any():
        raise ValueError("two following corners of a loop coincide")
    triples = zip(np.roll(corners, 1, axis=0), corners, np.roll(corners, -1, axis=0), strict=True)
    path = np.array([pose for before, corner, after in triples for pose in _corner(before, corner, after)])
    path = np.concatenate([path, path[:1]])
    distance = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(path[:, :2], axis=0).T))])
    return Loop(path[:, :2], np.unwrap(path[:, 2]), distance)
