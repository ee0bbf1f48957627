"""Compiled: one scan to two surfaces, ground and what stands on it, for the rule set `surface` (mapping.md 7.1-2).

Used between `locate` and `gradients` of `reconstruction_kernels.py`, with its slots and workspace `w`.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numba import njit

from orograph.layers import CONFIDENCE, CONFIDENCE_TOP, GRADIENT_X, GRADIENT_Y, HEIGHT, HEIGHT_TOP, OCCUPATION
from orograph.mapping.reconstruction_kernels import NONE, count_dropped, locate
from orograph.mapping.seeing_kernels import GROUND, UNCLEAR

FLAT, STEP, NEITHER = 0, 1, 2
"""What a scan shows in a cell: ground alone; something that stands; an overhang, or nothing to go by."""
GROUND_SURE = 32.0
"""Held ground of this confidence tells how high a point is above it."""
TOP_POINTS = 16.0
"""So many points on what stands in a cell make its top fully confident."""


@njit(cache=True, error_model="numpy")
def surfaces(
    xyz: Any, ranges_m: Any, range_max_m: float, x0: float, y0: float, cell_m: float, rows: int, cols: int, held: Any,
    raised: Any, rules: Any, w: Any, dropped: Any,
) -> int:  # fmt: skip
    """Give each point of ground in xyz (3, n) its slot (the others NONE), each slot its surfaces; the slots' number."""
    kept = locate(xyz, ranges_m, range_max_m, x0, y0, cell_m, rows, cols, w)
    if kept < xyz.shape[1]:
        count_dropped(xyz, ranges_m, range_max_m, w.cell_of_point, dropped)
    slots = fill_spread(xyz[2], raised, w)
    part_surfaces(xyz[2], ranges_m, range_max_m, slots, held, raised, rules, w)
    return slots


@njit(cache=True)
def fill_spread(zs: Any, raised: Any, w: Any) -> int:
    """Number the touched cells as slots; each slot's lowest and highest z, and whether a point of it is raised."""
    slot_of_cell, cell_of_slot, slot_of_point = w.slot_of_cell, w.cell_of_slot, w.slot_of_point
    cell_of_point, lowest, highest, kind, slots = w.cell_of_point, w.lowest, w.highest, w.kind, 0
    for i in range(zs.shape[0]):
        cell, z = cell_of_point[i], zs[i]
        if cell == NONE:
            slot_of_point[i] = NONE
            continue
        slot = slot_of_cell[cell]
        if slot == NONE:
            slot = np.uint32(slots)
            slots += 1
            slot_of_cell[cell], cell_of_slot[slot] = slot, cell
            lowest[slot] = highest[slot] = z
            kind[slot] = FLAT
        slot_of_point[i] = slot
        lowest[slot] = min(lowest[slot], z)
        highest[slot] = max(highest[slot], z)
        if raised[i] != GROUND:
            kind[slot] = NEITHER
    return slots


@njit(cache=True, error_model="numpy")
def part_surfaces(
    zs: Any, ranges_m: Any, range_max_m: float, slots: int, held: Any, raised: Any, rules: Any, w: Any
) -> None:
    """Tell each slot's kind, its top and its ground's mean z; only points of ground keep their slot, for what follows.

    A point stands when it is `step_m` or more over the foot: the lowest point, or the held ground if that is sure and
    lower. Something stands in a cell when one of these is no higher than `overhang_m`: else they hang over.
    """
    slot_of_point, lowest, highest, foot, kind = w.slot_of_point, w.lowest, w.highest, w.foot, w.kind
    count, height, values, top, weight = w.count_of_slot, w.height, w.values, w.top, w.weight
    for slot in range(slots):
        own = held[w.cell_of_slot[slot]]
        foot[slot] = min(lowest[slot], np.float64(own[HEIGHT])) if own[CONFIDENCE] >= GROUND_SURE else lowest[slot]
        if highest[slot] - foot[slot] >= rules.step_m:
            kind[slot] = NEITHER
        count[slot], height[slot], weight[slot] = 0, 0.0, 0.0
        top[slot, 0] = 0.0
        top[slot, 1] = top[slot, 2] = top[slot, 3] = -math.inf
    near_m, near_fall, far_fall = 0.75 * range_max_m, 0.2 / (0.75 * range_max_m), 0.2 / (0.20 * range_max_m)
    for i in range(zs.shape[0]):
        slot = slot_of_point[i]
        if slot == NONE:
            continue
        if raised[i] == UNCLEAR:
            continue
        above = zs[i] - foot[slot]
        if above < rules.step_m and raised[i] == GROUND:
            count[slot] += 1
            height[slot] += zs[i]
            continue
        distance_m = np.float64(ranges_m[i])
        beyond_m = distance_m - near_m
        weight[slot] += 1.0 - near_fall * distance_m if beyond_m <= 0.0 else 0.8 - far_fall * beyond_m
        keep_highest(top[slot], zs[i])
        if above <= rules.overhang_m:
            kind[slot] = STEP
    for slot in range(slots):
        values[slot, HEIGHT_TOP], values[slot, CONFIDENCE_TOP] = math.nan, 0.0
        if kind[slot] == STEP:
            n = top[slot, 0]
            values[slot, HEIGHT_TOP] = top[slot, 3] if n >= 3.0 else top[slot, 1]
            values[slot, CONFIDENCE_TOP] = 255.0 * min(n, TOP_POINTS) / TOP_POINTS * (weight[slot] / n)
        if kind[slot] == STEP or count[slot] == 0:
            count[slot] = 0
            w.slot_of_cell[w.cell_of_slot[slot]] = NONE  # no neighbour takes a slope from it
        height[slot] /= count[slot]
        values[slot, HEIGHT] = height[slot]
    for i in range(zs.shape[0]):
        slot = slot_of_point[i]
        if slot != NONE and (count[slot] == 0 or raised[i] != GROUND or zs[i] - foot[slot] >= rules.step_m):
            slot_of_point[i] = NONE


@njit(cache=True)
def keep_highest(top: Any, z: float) -> None:
    """Count a point and keep the three highest z: `top` is (number, highest, second, third)."""
    top[0] += 1.0
    if z > top[1]:
        top[1], top[2], top[3] = z, top[1], top[2]
    elif z > top[2]:
        top[2], top[3] = z, top[2]
    elif z > top[3]:
        top[3] = z


@njit(cache=True)
def blank_groundless(slots: int, w: Any) -> None:
    """Of slots without ground nothing is known of the ground."""
    count, values = w.count_of_slot, w.values
    for slot in range(slots):
        if count[slot] == 0:
            values[slot, HEIGHT] = values[slot, GRADIENT_X] = values[slot, GRADIENT_Y] = math.nan
            values[slot, OCCUPATION], values[slot, CONFIDENCE] = math.nan, 0.0
