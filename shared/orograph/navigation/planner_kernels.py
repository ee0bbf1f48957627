"""Compiled kernels of path planning: obstacle distance and A* on a cost grid (8-connected, no corner cutting)."""

from __future__ import annotations

import math
from typing import Any

import numba
import numpy as np

from orograph.arrays import F64, I64, U1, Mask

MET_BEFORE_S, MET_AFTER_S = 1.0, 1.5
"""The robot gets out of a mover's way so long before it comes, and into it so long after its front has passed."""


@numba.njit(cache=True)
def blocked_cells(occupation: U1, threshold: int, unknown: int, alone_counts: bool) -> Mask:
    """Cells (rows, cols) with occupation >= threshold; one without such a neighbour only if `alone_counts`."""
    rows, cols = occupation.shape
    out = np.zeros((rows, cols), np.bool_)
    for r in range(rows):
        for c in range(cols):
            value = occupation[r, c]
            if value < threshold or value == unknown:
                continue
            company = alone_counts
            for rr in range(max(0, r - 1), min(rows, r + 2)):
                for cc in range(max(0, c - 1), min(cols, c + 2)):
                    other = occupation[rr, cc]
                    company |= other >= threshold and other != unknown and (rr != r or cc != c)
            out[r, c] = company
    return out


@numba.njit(cache=True)
def obstacle_distance(blocked: Mask, reach: int) -> F64:
    """Distance (rows, cols) [cells] from each centre to the nearest blocked one, exact to `reach`, else reach + 1.

    Not scipy's `distance_transform_edt`: that knows no reach, and takes 5 to 7 times as long for the same numbers.
    """
    rows, cols = blocked.shape
    squared = np.full((rows, cols), float((reach + 1) ** 2))
    for r in range(rows):
        for c in range(cols):
            if not blocked[r, c]:
                continue
            squared[r, c] = 0.0
            inner = 0 < r < rows - 1 and 0 < c < cols - 1
            if inner and blocked[r - 1, c] and blocked[r + 1, c] and blocked[r, c - 1] and blocked[r, c + 1]:
                continue  # a cell between blocked ones is nobody's nearest
            for rr in range(max(0, r - reach), min(rows, r + reach + 1)):
                for cc in range(max(0, c - reach), min(cols, c + reach + 1)):
                    d = float((rr - r) ** 2 + (cc - c) ** 2)
                    if d < squared[rr, cc]:
                        squared[rr, cc] = d
    distance: F64 = np.minimum(np.sqrt(squared), reach + 1.0)
    return distance


@numba.njit(cache=True)
def _before(key: F64, a: int, b: int) -> bool:
    """Heap order: by key, cells with equal keys by index, so the same grid gives the same path on every machine."""
    return bool(key[a] < key[b] or (key[a] == key[b] and a < b))


@numba.njit(cache=True)
def _rise(heap: I64, place: I64, key: F64, i: int) -> None:
    node = heap[i]
    while i > 0:
        up = (i - 1) >> 1
        if not _before(key, node, heap[up]):
            break
        heap[i] = heap[up]
        place[heap[i]] = i
        i = up
    heap[i] = node
    place[node] = i


@numba.njit(cache=True)
def _sink(heap: I64, place: I64, key: F64, size: int) -> None:
    """Restore the order after the last entry was put at the root."""
    node, i = heap[0], 0
    while True:
        down = 2 * i + 1
        if down >= size:
            break
        if down + 1 < size and _before(key, heap[down + 1], heap[down]):
            down += 1
        if not _before(key, heap[down], node):
            break
        heap[i] = heap[down]
        place[heap[i]] = i
        i = down
    heap[i] = node
    place[node] = i


@numba.njit(cache=True)
def _octile(dr: int, dc: int) -> float:
    low, high = min(abs(dr), abs(dc)), max(abs(dr), abs(dc))
    return float(high - low) + math.sqrt(2.0) * low


@numba.njit(cache=True)
def least_cost_path(cost: F64, start: int, goal: int) -> tuple[Any, float]:
    """Cells (n,) from start to goal (flat indices, both included) and the path's cost; empty and inf if there is none.

    `cost` (rows, cols) is the cost of one cell side, >= 1 or inf where blocked; a step costs its length times the mean
    of its two cells. A diagonal step needs both cells beside it free.
    """
    rows, cols = cost.shape
    c = cost.reshape(-1)
    goal_r, goal_c = goal // cols, goal % cols
    spent = np.full(c.size, np.inf)
    key = np.full(c.size, np.inf)
    parent = np.full(c.size, -1, np.int64)
    place = np.full(c.size, -1, np.int64)  # -1 never seen, -2 settled, else the position in the heap
    heap = np.empty(c.size, np.int64)
    spent[start], key[start] = 0.0, _octile(start // cols - goal_r, start % cols - goal_c)
    heap[0], place[start], size = start, 0, 1
    while size > 0:
        node = heap[0]
        size -= 1
        place[node] = -2
        if node == goal:
            break
        if size > 0:
            heap[0] = heap[size]
            _sink(heap, place, key, size)
        r, k = node // cols, node % cols
        for dr in range(-1, 2):
            for dc in range(-1, 2):
                rr, kk = r + dr, k + dc
                if (dr == 0 and dc == 0) or rr < 0 or kk < 0 or rr >= rows or kk >= cols:
                    continue
                near = rr * cols + kk
                if place[near] == -2 or c[near] == np.inf:
                    continue
                length = 1.0
                if dr != 0 and dc != 0:
                    if c[rr * cols + k] == np.inf or c[r * cols + kk] == np.inf:
                        continue
                    length = math.sqrt(2.0)
                total = spent[node] + 0.5 * length * (c[node] + c[near])
                if total < spent[near]:
                    spent[near], parent[near] = total, node
                    key[near] = total + _octile(rr - goal_r, kk - goal_c)
                    if place[near] == -1:
                        heap[size], place[near] = near, size
                        size += 1
                    _rise(heap, place, key, place[near])
    if spent[goal] == np.inf:
        return np.empty(0, np.int64), np.inf
    return _trace(parent, start, goal), spent[goal]


@numba.njit(cache=True)
def _trace(parent: I64, start: int, goal: int) -> I64:
    length, node = 1, goal
    while node != start:
        node = parent[node]
        length += 1
    path = np.empty(length, np.int64)
    node = goal
    for i in range(length - 1, -1, -1):
        path[i] = node
        node = parent[node]
    return path


@numba.njit(cache=True)
def nearest_finite(cost: F64, row: int, col: int, reach: int) -> int:
    """Flat index of the finite cell nearest to (row, col) within `reach` cells, ties by index; -1 if there is none."""
    rows, cols = cost.shape
    best, best_squared = -1, reach * reach + 1
    for r in range(max(0, row - reach), min(rows, row + reach + 1)):
        for c in range(max(0, col - reach), min(cols, col + reach + 1)):
            squared = (r - row) ** 2 + (c - col) ** 2
            if squared < best_squared and cost[r, c] < np.inf:
                best, best_squared = r * cols + c, squared
    return best


@numba.njit(cache=True)
def obstacle_near_m(
    x_m: float,
    y_m: float,
    occupation: U1,
    frame: tuple[float, float, float],
    threshold: int,
    unknown: int,
    reach_m: float,
) -> float:
    """Distance [m] from a point to the nearest obstacle cell's centre, `reach_m` if there is none within.

    `frame` is (x0, y0, cell side) of the occupation grid. A blocked cell counts if a neighbour is blocked too.
    """
    rows, cols = occupation.shape
    x0, y0, cell_m = frame
    reach = math.ceil(reach_m / cell_m)
    col, row = math.floor((x_m - x0) / cell_m), math.floor((y_m - y0) / cell_m)
    nearest = reach_m
    for r in range(max(1, row - reach), min(rows - 1, row + reach + 1)):
        for c in range(max(1, col - reach), min(cols - 1, col + reach + 1)):
            if occupation[r, c] < threshold or occupation[r, c] == unknown:
                continue
            distance = math.hypot(x0 + (c + 0.5) * cell_m - x_m, y0 + (r + 0.5) * cell_m - y_m)
            if distance >= nearest:
                continue
            for rr in range(r - 1, r + 2):
                for cc in range(c - 1, c + 2):
                    other = occupation[rr, cc]
                    if other >= threshold and other != unknown and (rr != r or cc != c):
                        nearest = distance
    return nearest


@numba.njit(cache=True)
def first_blocked(
    xy_m: F64,
    first: int,
    last: int,
    occupation: U1,
    frame: tuple[float, float, float],
    threshold: int,
    unknown: int,
    radius_m: float,
) -> int:
    """Index in [first, last) of the first path point with an obstacle nearer than `radius_m`, -1 if there is none."""
    for i in range(first, last):
        if obstacle_near_m(xy_m[i, 0], xy_m[i, 1], occupation, frame, threshold, unknown, radius_m) < radius_m:
            return i
    return -1


@numba.njit(cache=True)
def first_met(
    path_m: F64, arrival_s: F64, cells_m: F64, times_s: F64, moved_m: F64, reach_m: F64
) -> tuple[int, int, int]:
    """Where a path (n, 2) meets cells (k, 2) that move: the first point met, the last before it where one may wait,
    and the first to which the cells ever come; -1 where there is no such point.

    The robot is at each point at `arrival_s` (n,); by `times_s` (m,) the cells will have `moved_m` (m, 2) and keep
    others off by `reach_m` (m,). Where one may wait they never come.
    """
    safe, swept = -1, -1
    for i in range(len(path_m)):
        comes = False
        for t in range(len(times_s)):
            x, y = path_m[i, 0] - moved_m[t, 0], path_m[i, 1] - moved_m[t, 1]
            for k in range(len(cells_m)):
                if (x - cells_m[k, 0]) ** 2 + (y - cells_m[k, 1]) ** 2 < reach_m[t] ** 2:
                    comes = True
                    if times_s[t] - MET_BEFORE_S <= arrival_s[i] <= times_s[t] + MET_AFTER_S:
                        return i, safe, i if swept < 0 else swept
                    break
        if not comes:
            safe = i
        elif swept < 0:
            swept = i
    return -1, safe, swept
