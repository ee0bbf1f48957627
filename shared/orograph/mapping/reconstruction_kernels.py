"""Compiled: one scan to the values of the cells it touched, one stage of mapping.md section 2 per kernel.

A touched cell gets a *slot*, numbered in the order of first touch, so that every later pass works on as few bytes as
the scan has cells. Sums are float64, taken around the cell's centre and mean height to lose no digits far out. `w` is
the workspace of `reconstruction.py`; its arrays are named first, for numba counts references at each mention of one.
Indices are unsigned, for numba asks of signed ones whether they count from the end; NumPy's rule for a division by
zero (there is none) keeps that question out of the loops too.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numba import njit

from orograph.layers import CONFIDENCE, GRADIENT_X, GRADIENT_Y, HEIGHT, OCCUPATION

NOT_FINITE, BEYOND_RANGE, OUTSIDE_GRID = 0, 1, 2
NONE = np.uint32(0xFFFF_FFFF)
"""Of a point: dropped; of a cell: no slot."""


@njit(cache=True, error_model="numpy")
def heights(
    xyz: Any, ranges_m: Any, range_max_m: float, x0: float, y0: float, cell_m: float, rows: int, cols: int, w: Any,
    dropped: Any,
) -> int:  # fmt: skip
    """Give each point of xyz (3, n) its slot (or NONE) and each slot its mean z; returns the slots' number."""
    cell_of_point, height, values, count = w.cell_of_point, w.height, w.values, w.count_of_slot
    kept = locate(xyz, ranges_m, range_max_m, x0, y0, cell_m, rows, cols, w)
    if kept < xyz.shape[1]:
        count_dropped(xyz, ranges_m, range_max_m, cell_of_point, dropped)
    slots = fill_slots(xyz[2], w)
    for slot in range(slots):
        height[slot] /= count[slot]
        values[slot, HEIGHT] = height[slot]
    return slots


@njit(cache=True, error_model="numpy")
def locate(
    xyz: Any, ranges_m: Any, range_max_m: float, x0: float, y0: float, cell_m: float, rows: int, cols: int, w: Any
) -> int:
    """Each point's cell (or NONE), sub-cell and place from the cell's centre [cells]; returns how many have a cell.

    Without a branch, so that it runs on many points at once.
    """
    xs, ys, zs = xyz[0], xyz[1], xyz[2]
    kept = np.int64(0)
    cell_of_point, sub_cell, east, north = w.cell_of_point, w.sub_cell, w.east, w.north
    for i in range(xs.shape[0]):
        u, v, distance_m = (xs[i] - x0) / cell_m, (ys[i] - y0) / cell_m, ranges_m[i]
        good = (u >= 0.0) & (u < cols) & (v >= 0.0) & (v < rows) & (abs(zs[i]) < math.inf)
        good &= (distance_m > -math.inf) & (distance_m <= range_max_m)
        u, v = u if good else 0.0, v if good else 0.0
        col, row = np.floor(u), np.floor(v)
        u, v = u - col, v - row
        east[i], north[i] = u - 0.5, v - 0.5
        sub_cell[i] = np.int32(v * 4.0) * np.int32(4) + np.int32(u * 4.0)
        cell_of_point[i] = np.uint32(np.int32(row) * np.int32(cols) + np.int32(col)) if good else NONE
        kept += np.int64(good)
    return int(kept)


@njit(cache=True)
def count_dropped(xyz: Any, ranges_m: Any, range_max_m: float, cell_of_point: Any, dropped: Any) -> None:
    """Count by reason the points that `locate` gave no cell."""
    for i in range(xyz.shape[1]):
        if cell_of_point[i] != NONE:
            continue
        finite = math.isfinite(xyz[0, i]) and math.isfinite(xyz[1, i]) and math.isfinite(xyz[2, i])
        if not (finite and math.isfinite(ranges_m[i])):
            dropped[NOT_FINITE] += 1
        else:
            dropped[BEYOND_RANGE if ranges_m[i] > range_max_m else OUTSIDE_GRID] += 1


@njit(cache=True)
def within(x: float, y: float, extent_m: Any) -> bool:
    """Whether a point lies in a rectangle (x_min, y_min, x_max, y_max), half-open as cells are."""
    return bool((x >= extent_m[0]) & (y >= extent_m[1]) & (x < extent_m[2]) & (y < extent_m[3]))


@njit(cache=True)
def count_beyond(xyz: Any, window_m: Any, map_m: Any) -> int:
    """How many of xyz (3, n) lie in a window, but not in the map (x_min, y_min, x_max, y_max)."""
    xs, ys, count = xyz[0], xyz[1], np.int64(0)
    for i in range(xs.shape[0]):
        count += np.int64(within(xs[i], ys[i], window_m) & (not within(xs[i], ys[i], map_m)))
    return int(count)


@njit(cache=True)
def fill_slots(zs: Any, w: Any) -> int:
    """Number the touched cells as slots; count each slot's points and sum their z."""
    slot_of_cell, cell_of_slot, slot_of_point = w.slot_of_cell, w.cell_of_slot, w.slot_of_point
    cell_of_point, count, height, slots = w.cell_of_point, w.count_of_slot, w.height, 0
    for i in range(zs.shape[0]):
        cell = cell_of_point[i]
        if cell == NONE:
            slot_of_point[i] = NONE
            continue
        slot = slot_of_cell[cell]
        if slot == NONE:
            slot = np.uint32(slots)
            slots += 1
            slot_of_cell[cell], cell_of_slot[slot] = slot, cell
            count[slot], height[slot] = 0, 0.0
        slot_of_point[i] = slot
        count[slot] += 1
        height[slot] += zs[i]
    return slots


@njit(cache=True, error_model="numpy")
def neighbour_slope(lower: Any, own: Any, upper: Any, height: Any, cell_m: float) -> float:
    """Eq. 8-9, centred: the slope along one axis from the slots of both neighbours (or NONE) and the cell's own."""
    if lower == NONE and upper == NONE:
        return math.nan
    below, above = own if lower == NONE else lower, own if upper == NONE else upper
    return float((height[above] - height[below]) / (cell_m if below == own or above == own else 2.0 * cell_m))


@njit(cache=True)
def neighbours_slopes(
    slot: int, cell: int, cell_m: float, rows: int, cols: int, slot_of_cell: Any, height: Any
) -> tuple[float, float]:
    """Slopes along x and y of a cell from its four neighbours' heights."""
    row = cell // cols
    col = cell - row * cols
    west = slot_of_cell[cell - 1] if col > 0 else NONE
    east = slot_of_cell[cell + 1] if col + 1 < cols else NONE
    south = slot_of_cell[cell - cols] if row > 0 else NONE
    north = slot_of_cell[cell + cols] if row + 1 < rows else NONE
    own = np.uint32(slot)
    return neighbour_slope(west, own, east, height, cell_m), neighbour_slope(south, own, north, height, cell_m)


@njit(cache=True)
def sum_moments(zs: Any, slots: int, w: Any) -> None:
    """First and second moments of each slot's points around its cell's centre [cells] and mean height [m].

    Neighbours in memory differ by the same axis, so that the compiler adds two sums at once.
    """
    slot_of_point, east, north, height, moments = w.slot_of_point, w.east, w.north, w.height, w.moments
    moments[:slots] = 0.0
    for i in range(zs.shape[0]):
        slot = slot_of_point[i]
        if slot == NONE:
            continue
        x, y, z = east[i], north[i], zs[i] - height[slot]
        total = moments[slot]
        total[0] += x
        total[1] += y
        total[2] += x * x
        total[3] += y * y
        total[4] += x * z
        total[5] += y * z
        total[6] += x * y


@njit(cache=True, error_model="numpy")
def gradients(zs: Any, slots: int, cell_m: float, rows: int, cols: int, w: Any) -> None:
    """Eq. 1-7: slopes of each slot's least-squares plane; where its points cannot carry one, of its neighbours."""
    sum_moments(zs, slots, w)
    slot_of_cell, cell_of_slot, count, height = w.slot_of_cell, w.cell_of_slot, w.count_of_slot, w.height
    moments, values = w.moments, w.values
    spread_min = 1.0 / 400.0  # (cell / 20)^2
    for slot in range(slots):
        n, m = float(count[slot]), moments[slot]
        mean_x, mean_y = m[0] / n, m[1] / n
        xx, yy, xy = m[2] / n - mean_x * mean_x, m[3] / n - mean_y * mean_y, m[6] / n - mean_x * mean_y
        half_difference = 0.5 * (xx - yy)
        spread = 0.5 * (xx + yy) - math.sqrt(half_difference * half_difference + xy * xy)
        if n >= 3.0 and spread >= spread_min:
            xz, yz, det = m[4] / n, m[5] / n, (xx * yy - xy * xy) * cell_m
            values[slot, GRADIENT_X], values[slot, GRADIENT_Y] = (xz * yy - yz * xy) / det, (yz * xx - xz * xy) / det
        else:
            slopes = neighbours_slopes(slot, cell_of_slot[slot], cell_m, rows, cols, slot_of_cell, height)
            values[slot, GRADIENT_X], values[slot, GRADIENT_Y] = slopes


@njit(cache=True, error_model="numpy")
def confidences(ranges_m: Any, slots: int, range_max_m: float, w: Any) -> None:
    """Section 2.4: 255 * (hit sub-cells / 16) * mean of f(D) (Eq. 10 as read)."""
    slot_of_point, sub_cell, count, values = w.slot_of_point, w.sub_cell, w.count_of_slot, w.values
    hits, weight = w.hits, w.weight
    hits[:slots] = 0
    weight[:slots] = 0.0
    near_m, near_fall, far_fall = 0.75 * range_max_m, 0.2 / (0.75 * range_max_m), 0.2 / (0.20 * range_max_m)
    for i in range(ranges_m.shape[0]):
        slot = slot_of_point[i]
        if slot == NONE:
            continue
        hits[slot] |= 1 << sub_cell[i]
        distance_m = np.float64(ranges_m[i])
        beyond_m = distance_m - near_m
        weight[slot] += 1.0 - near_fall * distance_m if beyond_m <= 0.0 else 0.8 - far_fall * beyond_m
    for slot in range(slots):
        bits = hits[slot] - ((hits[slot] >> 1) & 0x5555)  # counts in pairs, fours, eights of bits side by side
        bits = (bits & 0x3333) + ((bits >> 2) & 0x3333)
        bits = (bits + (bits >> 4)) & 0x0F0F
        hit_sub_cells = (bits + (bits >> 8)) & 0x1F
        values[slot, CONFIDENCE] = 255.0 * (hit_sub_cells / 16.0) * (weight[slot] / count[slot])


@njit(cache=True, error_model="numpy")
def occupations(slots: int, slope_max: float, values: Any) -> None:
    """Section 2.3: slope over the largest passable one, at most 1; NaN where a gradient is unknown."""
    for slot in range(slots):
        gx, gy = np.float64(values[slot, GRADIENT_X]), np.float64(values[slot, GRADIENT_Y])
        share = math.sqrt(gx * gx + gy * gy) / slope_max
        values[slot, OCCUPATION] = 1.0 if share > 1.0 else share


@njit(cache=True)
def release(slots: int, cell_of_slot: Any, slot_of_cell: Any) -> None:
    """Make the cell -> slot table ready for the next scan."""
    for slot in range(slots):
        slot_of_cell[cell_of_slot[slot]] = NONE
