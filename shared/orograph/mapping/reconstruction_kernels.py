"""Compiled: one scan to the values of the cells it touched, one stage of mapping.md section 2 per kernel.

A touched cell gets a *slot*, numbered in the order of first touch, so that every later pass works on as few bytes as
the scan has cells. Sums are float64, taken around the cell's centre and mean height to lose no digits far out. `w` is
the workspace of `reconstruction.py`; its arrays are named first, for numba counts references at each mention of one.
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
    """Give each point its slot (-1: dropped, counted by reason) and each slot its mean z; returns the slots' number."""
    slot_of_cell, cell_of_slot, slot_of_point, sub_cell = w.slot_of_cell, w.cell_of_slot, w.slot_of_point, w.sub_cell
    centre, count, height, values = w.centre, w.count_of_slot, w.height, w.values
    slots = 0
    for i in range(points.shape[0]):
        slot_of_point[i] = -1
        x, y, z, distance_m = points[i, 0], points[i, 1], points[i, 2], ranges_m[i]
        u, v = (x - x0) / cell_m, (y - y0) / cell_m
        inside = 0.0 <= u < cols and 0.0 <= v < rows
        if not (inside and abs(z) < math.inf and -math.inf < distance_m <= range_max_m):
            dropped[drop_reason(x, y, z, distance_m, range_max_m)] += 1
            continue
        row, col = int(v), int(u)
        cell = row * cols + col
        slot = slot_of_cell[cell]
        if slot < 0:
            slot, slots = slots, slots + 1
            slot_of_cell[cell], cell_of_slot[slot] = slot, cell
            centre[slot, 0], centre[slot, 1] = x0 + (col + 0.5) * cell_m, y0 + (row + 0.5) * cell_m
            count[slot], height[slot] = 0, 0.0
        slot_of_point[i] = slot
        sub_cell[i] = 4 * int((v - row) * 4.0) + int((u - col) * 4.0)
        count[slot] += 1
        height[slot] += z
    for slot in range(slots):
        height[slot] /= count[slot]
        values[slot, 0] = height[slot]
    return slots


@njit(cache=True)
def drop_reason(x: float, y: float, z: float, distance_m: float, range_max_m: float) -> int:
    """Why a point is of no use; apart from `heights`, whose loop asks all at once."""
    if not (math.isfinite(x) and math.isfinite(y) and math.isfinite(z) and math.isfinite(distance_m)):
        return NOT_FINITE
    return BEYOND_RANGE if distance_m > range_max_m else OUTSIDE_GRID


@njit(cache=True)
def neighbour_slope(lower: int, own: int, upper: int, height: Any, cell_m: float) -> float:
    """Eq. 8-9, centred: the slope along one axis from the slots of both neighbours (-1: unknown) and the cell's own."""
    if lower < 0 and upper < 0:
        return math.nan
    below, above = lower if lower >= 0 else own, upper if upper >= 0 else own
    return float((height[above] - height[below]) / (cell_m if below == own or above == own else 2.0 * cell_m))


@njit(cache=True)
def neighbours_slopes(
    slot: int, cell: int, cell_m: float, rows: int, cols: int, slot_of_cell: Any, height: Any
) -> tuple[float, float]:
    """Slopes along x and y of a cell from its four neighbours' heights."""
    row = cell // cols
    col = cell - row * cols
    west = slot_of_cell[cell - 1] if col > 0 else -1
    east = slot_of_cell[cell + 1] if col + 1 < cols else -1
    south = slot_of_cell[cell - cols] if row > 0 else -1
    north = slot_of_cell[cell + cols] if row + 1 < rows else -1
    return neighbour_slope(west, slot, east, height, cell_m), neighbour_slope(south, slot, north, height, cell_m)


@njit(cache=True)
def sum_moments(points: Any, slots: int, w: Any) -> None:
    """First and second moments of each slot's points around its cell's centre and mean height."""
    slot_of_point, centre, height, moments = w.slot_of_point, w.centre, w.height, w.moments
    moments[:slots] = 0.0
    for i in range(points.shape[0]):
        slot = slot_of_point[i]
        if slot < 0:
            continue
        x, y, z = points[i, 0] - centre[slot, 0], points[i, 1] - centre[slot, 1], points[i, 2] - height[slot]
        total = moments[slot]
        total[0] += x
        total[1] += y
        total[2] += x * x
        total[3] += x * y
        total[4] += y * y
        total[5] += x * z
        total[6] += y * z


@njit(cache=True)
def gradients(points: Any, slots: int, cell_m: float, rows: int, cols: int, w: Any) -> None:
    """Eq. 1-7: slopes of each slot's least-squares plane; where its points cannot carry one, of its neighbours."""
    sum_moments(points, slots, w)
    slot_of_cell, cell_of_slot, count, height = w.slot_of_cell, w.cell_of_slot, w.count_of_slot, w.height
    moments, values = w.moments, w.values
    spread_min = (cell_m / 20.0) ** 2
    for slot in range(slots):
        n, m = count[slot], moments[slot]
        mean_x, mean_y = m[0] / n, m[1] / n
        xx, xy, yy = m[2] / n - mean_x * mean_x, m[3] / n - mean_x * mean_y, m[4] / n - mean_y * mean_y
        half_difference = 0.5 * (xx - yy)
        spread = 0.5 * (xx + yy) - math.sqrt(half_difference * half_difference + xy * xy)
        if n >= 3 and spread >= spread_min:
            xz, yz, det = m[5] / n, m[6] / n, xx * yy - xy * xy
            values[slot, 1], values[slot, 2] = (xz * yy - yz * xy) / det, (yz * xx - xz * xy) / det
        else:
            cell = cell_of_slot[slot]
            slopes = neighbours_slopes(slot, cell, cell_m, rows, cols, slot_of_cell, height)
            values[slot, 1], values[slot, 2] = slopes


@njit(cache=True)
def confidences(ranges_m: Any, slots: int, range_max_m: float, w: Any) -> None:
    """Section 2.4: 255 * (hit sub-cells / 16) * mean of f(D) (Eq. 10 as read)."""
    slot_of_point, sub_cell, count, values = w.slot_of_point, w.sub_cell, w.count_of_slot, w.values
    hits, weight = w.hits, w.weight
    hits[:slots] = 0
    weight[:slots] = 0.0
    near_m, near_fall, far_fall = 0.75 * range_max_m, 0.2 / (0.75 * range_max_m), 0.2 / (0.20 * range_max_m)
    for i in range(ranges_m.shape[0]):
        slot = slot_of_point[i]
        if slot < 0:
            continue
        hits[slot] |= 1 << sub_cell[i]
        distance_m = np.float64(ranges_m[i])
        beyond_m = distance_m - near_m
        weight[slot] += 1.0 - near_fall * distance_m if beyond_m <= 0.0 else 0.8 - far_fall * beyond_m
    for slot in range(slots):
        hit_sub_cells, bits = 0, hits[slot]
        while bits:
            bits &= bits - 1
            hit_sub_cells += 1
        values[slot, 4] = 255.0 * (hit_sub_cells / 16.0) * (weight[slot] / count[slot])


@njit(cache=True)
def occupations(slots: int, slope_max: float, values: Any) -> None:
    """Section 2.3: slope over the largest passable one, at most 1; NaN where a gradient is unknown."""
    for slot in range(slots):
        gx, gy = np.float64(values[slot, 1]), np.float64(values[slot, 2])
        share = math.sqrt(gx * gx + gy * gy) / slope_max
        values[slot, 3] = 1.0 if share > 1.0 else share


@njit(cache=True)
def release(slots: int, cell_of_slot: Any, slot_of_cell: Any) -> None:
    """Make the cell -> slot table ready for the next scan."""
    for slot in range(slots):
        slot_of_cell[cell_of_slot[slot]] = -1
