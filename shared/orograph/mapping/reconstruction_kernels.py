"""Compiled: one scan to the values of the cells it touched, one stage of mapping.md section 2 per kernel.

A touched cell gets a *slot*, numbered in the order of first touch, so that every later pass works on as few bytes as
the scan has cells. Sums are float64, taken around the cell's centre and mean height to lose no digits far out.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numba import njit

NOT_FINITE, BEYOND_RANGE, OUTSIDE_GRID = 0, 1, 2


@njit(cache=True)
def heights(
    points: Any, ranges_m: Any, range_max_m: float, x0: float, y0: float, cell_m: float, rows: int, cols: int, w: Any,
    dropped: Any,
) -> int:  # fmt: skip
    """Give each point its slot (-1: dropped, counted by reason) and each slot the mean z; returns the slots' number."""
    slots = 0
    for i in range(points.shape[0]):
        w.slot_of_point[i] = -1
        x, y, z, distance_m = points[i, 0], points[i, 1], points[i, 2], ranges_m[i]
        if not (math.isfinite(x) and math.isfinite(y) and math.isfinite(z) and math.isfinite(distance_m)):
            dropped[NOT_FINITE] += 1
            continue
        if distance_m > range_max_m:
            dropped[BEYOND_RANGE] += 1
            continue
        col, row = math.floor((x - x0) / cell_m), math.floor((y - y0) / cell_m)
        if not (0 <= col < cols and 0 <= row < rows):
            dropped[OUTSIDE_GRID] += 1
            continue
        cell = row * cols + col
        slot = w.slot_of_cell[cell]
        if slot < 0:
            slot, slots = slots, slots + 1
            w.slot_of_cell[cell], w.cell_of_slot[slot] = slot, cell
            w.centre[slot, 0], w.centre[slot, 1] = x0 + (col + 0.5) * cell_m, y0 + (row + 0.5) * cell_m
            w.points[slot], w.height[slot] = 0, 0.0
        w.slot_of_point[i] = slot
        w.points[slot] += 1
        w.height[slot] += z
    for slot in range(slots):
        w.height[slot] /= w.points[slot]
        w.values[slot, 0] = w.height[slot]
    return slots


@njit(cache=True)
def neighbour_slope(lower: int, own: int, upper: int, height: Any, cell_m: float) -> float:
    """Eq. 8-9, centred: the slope along one axis from the slots of both neighbours (-1: unknown) and the cell's own."""
    if lower < 0 and upper < 0:
        return math.nan
    below, above = lower if lower >= 0 else own, upper if upper >= 0 else own
    return float((height[above] - height[below]) / (cell_m if below == own or above == own else 2.0 * cell_m))


@njit(cache=True)
def neighbours_slopes(slot: int, cell_m: float, rows: int, cols: int, w: Any) -> tuple[float, float]:
    """Slopes along x and y of a cell from its four neighbours' heights."""
    cell = w.cell_of_slot[slot]
    row, col = cell // cols, cell % cols
    west = w.slot_of_cell[cell - 1] if col > 0 else -1
    east = w.slot_of_cell[cell + 1] if col + 1 < cols else -1
    south = w.slot_of_cell[cell - cols] if row > 0 else -1
    north = w.slot_of_cell[cell + cols] if row + 1 < rows else -1
    return (
        neighbour_slope(west, slot, east, w.height, cell_m),
        neighbour_slope(south, slot, north, w.height, cell_m),
    )


@njit(cache=True)
def gradients(points: Any, slots: int, cell_m: float, rows: int, cols: int, w: Any) -> None:
    """Eq. 1-7: slopes of each slot's least-squares plane; where its points cannot carry one, of its neighbours."""
    w.moments[:slots] = 0.0
    for i in range(points.shape[0]):
        slot = w.slot_of_point[i]
        if slot < 0:
            continue
        x, y = points[i, 0] - w.centre[slot, 0], points[i, 1] - w.centre[slot, 1]
        z = points[i, 2] - w.height[slot]
        m = w.moments[slot]
        m[0] += x
        m[1] += y
        m[2] += x * x
        m[3] += x * y
        m[4] += y * y
        m[5] += x * z
        m[6] += y * z
    spread_min = (cell_m / 20.0) ** 2
    for slot in range(slots):
        n, m = w.points[slot], w.moments[slot]
        mean_x, mean_y = m[0] / n, m[1] / n
        xx, xy, yy = m[2] / n - mean_x * mean_x, m[3] / n - mean_x * mean_y, m[4] / n - mean_y * mean_y
        half_difference = 0.5 * (xx - yy)
        spread = 0.5 * (xx + yy) - math.sqrt(half_difference * half_difference + xy * xy)
        if n >= 3 and spread >= spread_min:
            xz, yz, det = m[5] / n, m[6] / n, xx * yy - xy * xy
            w.values[slot, 1], w.values[slot, 2] = (xz * yy - yz * xy) / det, (yz * xx - xz * xy) / det
        else:
            w.values[slot, 1], w.values[slot, 2] = neighbours_slopes(slot, cell_m, rows, cols, w)


@njit(cache=True)
def confidences(
    points: Any, ranges_m: Any, slots: int, range_max_m: float, x0: float, y0: float, cell_m: float, w: Any
) -> None:
    """Section 2.4: 255 * (hit sub-cells / 16) * mean of f(D) (Eq. 10 as read)."""
    w.hits[:slots] = 0
    w.weight[:slots] = 0.0
    near_m, far_m = 0.75 * range_max_m, 0.20 * range_max_m
    for i in range(points.shape[0]):
        slot = w.slot_of_point[i]
        if slot < 0:
            continue
        u, v = (points[i, 0] - x0) / cell_m, (points[i, 1] - y0) / cell_m
        sub_cell = 4 * int((v - math.floor(v)) * 4.0) + int((u - math.floor(u)) * 4.0)
        w.hits[slot] |= 1 << sub_cell
        distance_m = ranges_m[i]
        beyond_m = distance_m - near_m
        w.weight[slot] += 1.0 - 0.2 * distance_m / near_m if beyond_m <= 0.0 else 0.8 - 0.2 * beyond_m / far_m
    for slot in range(slots):
        hit_sub_cells, bits = 0, w.hits[slot]
        while bits:
            bits &= bits - 1
            hit_sub_cells += 1
        w.values[slot, 4] = 255.0 * (hit_sub_cells / 16.0) * (w.weight[slot] / w.points[slot])


@njit(cache=True)
def occupations(slots: int, slope_max: float, w: Any) -> None:
    """Section 2.3: slope over the largest passable one, at most 1; NaN where a gradient is unknown."""
    for slot in range(slots):
        gx, gy = np.float64(w.values[slot, 1]), np.float64(w.values[slot, 2])
        share = math.sqrt(gx * gx + gy * gy) / slope_max
        w.values[slot, 3] = 1.0 if share > 1.0 else share


@njit(cache=True)
def release(slots: int, w: Any) -> None:
    """Make the cell -> slot table ready for the next scan."""
    for slot in range(slots):
        w.slot_of_cell[w.cell_of_slot[slot]] = -1
