"""Compiled: which rays of a scan pass through what stands in the map (mapping.md 7.4).

Rays are sorted by the direction in which they leave, so that a cell looks at the few that can have crossed it. The
direction is not an angle but y / (|x| + |y|) and its like in the other quadrants, which every host computes alike.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numba import njit

from orograph.layers import FREE_SHARE, WALL_SHARE

BINS = 2048
"""Directions told apart, 512 a quadrant: a third of a degree where they are widest."""
PER_UNIT = BINS / 4.0
BESIDE = 0.3
"""A ray crosses a cell when it passes its centre within so many cell sides."""
BEYOND = 1.0
"""... and ends at least so many cell sides behind its centre."""
NEAREST = 2.0
"""Nearer to the eye, in cell sides, nothing is judged."""
LOW_M = 1.0
"""A ray that is no higher than this over the eye shows that no house stands where it passes."""
STEEP = 2.0
"""Rising by so much per metre is no ground."""
SIDE_BY_SIDE = 0.1
"""Rays that rise by no more than this apart see the same thing, if they see things at one distance."""
BEHIND = 0.1
"""Behind something that stands ground may rise by so much per metre: what is higher is rather its roof."""
FOOT_M = 0.15
"""The lower of two such points is their foot, and ground, unless it is higher over the last ground than this."""
GROUND, RAISED, UNCLEAR = 0, 1, 2
GAP_M, UNLIKE = 2.0, 0.15
"""Over a wider gap ground that rises by so much more per metre than before is taken for neither."""
NOISE_M = 0.05
"""Points less than this above each other are noise, not steepness."""


@njit(cache=True, error_model="numpy")
def direction(x: float, y: float) -> float:
    """0..4, growing counter-clockwise from east; NaN straight up and down."""
    share = y / (abs(x) + abs(y))
    if x >= 0.0:
        return share if y >= 0.0 else share + 4.0
    return 2.0 - share


@njit(cache=True, error_model="numpy")
def sort_rays(
    xyz: Any, eye_m: Any, beyond_m: float, rise_max: float, first: Any, order: Any, reach_m: Any, rise: Any,
    low_m: Any, far_m: Any,
) -> None:  # fmt: skip
    """Rays by direction, and within one from the lowest up: bin b holds places `first[b]` to `first[b + 1]`.

    At a place stand the point's number in xyz (3, n), its horizontal reach [m] and its rise [m/m]. `low_m` (BINS,) is
    how far each bin's rays go, `beyond_m` short of their ends, before they are higher than LOW_M; `far_m` is the
    longest reach. Points that are not finite, or rise by more than `rise_max`, belong to no bin.

    By insertion, as lasers give their rings in order: from the last point on where they give the uppermost first.
    """
    n, falls_m = xyz.shape[1], 0.0
    bins = np.empty(n, np.int32)
    first[:] = 0
    low_m[:] = 0.0
    far_m[:] = 0.0
    for i in range(n):
        x, y, z = xyz[0, i] - eye_m[0], xyz[1, i] - eye_m[1], xyz[2, i] - eye_m[2]
        turn, known = direction(x, y), abs(z) < math.inf and z <= rise_max * math.sqrt(x * x + y * y)
        bins[i] = np.int32(turn * PER_UNIT) & (BINS - 1) if known and abs(turn) <= 4.0 else -1
        if bins[i] >= 0:
            first[bins[i] + 1] += 1
            falls_m += z if 2 * i < n else -z
    for b in range(BINS):
        first[b + 1] += first[b]
    end, backwards = first[:BINS].copy(), falls_m > 0.0
    for place in range(n):
        i = n - 1 - place if backwards else place
        b = bins[i]
        if b < 0:
            continue
        x, y = xyz[0, i] - eye_m[0], xyz[1, i] - eye_m[1]
        flat_m = math.sqrt(x * x + y * y)
        up = (xyz[2, i] - eye_m[2]) / flat_m
        k = end[b]
        while k > first[b] and (rise[k - 1] > up or (backwards and rise[k - 1] == up)):
            order[k], reach_m[k], rise[k] = order[k - 1], reach_m[k - 1], rise[k - 1]
            k -= 1
        order[k], reach_m[k], rise[k] = i, flat_m, up
        end[b] += 1
        far_m[b] = max(far_m[b], flat_m)
        low_m[b] = max(low_m[b], min(flat_m - beyond_m, LOW_M / up) if up > 0.0 else flat_m - beyond_m)


@njit(cache=True)
def find_raised(
    steepest: float, first: Any, order: Any, reach_m: Any, rise: Any, raised: Any, clear_m: Any
) -> None:  # fmt: skip
    """Mark in `raised` (n,) the points that are RAISED or UNCLEAR, direction by direction; the others are GROUND.

    `clear_m` (BINS,) becomes the reach of the nearest raised one of each direction.

    Raised: they lie one above the other on something steep, or over the ray to the last ground, or higher than a slope
    of `steepest` leads from there. Unclear: ground that leads there would be unlike what was seen of it, over a gap in
    which nothing was seen.
    """
    raised[:] = GROUND
    clear_m[:] = math.inf
    for b in range(BINS):
        ground_m, ground_z_m, trend, slope, upright = 0.0, 0.0, 0.0, steepest, False
        for k in range(first[b], first[b + 1]):
            reach, z = reach_m[k], rise[k] * reach_m[k]  # over the eye
            away_m, over_m = abs(reach - ground_m), z - ground_z_m
            passed = reach < ground_m and z - ground_z_m * reach / ground_m > FOOT_M
            up = upright or passed or over_m > slope * away_m + NOISE_M
            upright = k + 1 < first[b + 1] and above(reach, rise[k], reach_m[k + 1], rise[k + 1])
            if up or (upright and over_m > BEHIND * away_m + FOOT_M):
                raised[order[k]], slope = RAISED, BEHIND
                clear_m[b] = min(clear_m[b], reach)
            elif (away_m > GAP_M and over_m > (trend + UNLIKE) * away_m) or (upright and over_m > FOOT_M):
                raised[order[k]] = UNCLEAR
            else:
                trend = max(over_m / away_m, 0.0) if away_m > FOOT_M else trend
                ground_m, ground_z_m = reach, z


@njit(cache=True)
def above(low_m: float, low_rise: float, high_m: float, high_rise: float) -> bool:
    """Whether the second of two rays, in order of their rise, ends above the first on something steep."""
    up_m = high_rise * high_m - low_rise * low_m
    return high_rise - low_rise <= SIDE_BY_SIDE and up_m > NOISE_M and up_m > STEEP * abs(high_m - low_m)


@njit(cache=True, error_model="numpy")
def bins_across(x: float, y: float, cell_m: float) -> Any:
    """The first and the last bin of the rays that pass a cell's centre (x, y) [m, from the eye] near enough."""
    across = abs(x) + abs(y)
    half = BESIDE * cell_m * math.sqrt(x * x + y * y) / (across * across)  # of a direction's unit, seen from here
    turn = direction(x, y)
    return math.floor((turn - half) * PER_UNIT), math.floor((turn + half) * PER_UNIT)


@njit(cache=True, error_model="numpy")
def count_passes(
    cells: Any, tops_m: Any, cols: int, x0: float, y0: float, cell_m: float, eye_m: Any, first: Any, reach_m: Any,
    rise: Any, far_m: Any, clear_m: Any, passes: Any,
) -> None:  # fmt: skip
    """How many sorted rays cross each of `cells` (k,) below its top (k,) [m] and go on: into `passes` (k,).

    Beyond `clear_m` (BINS,) rays of a direction do not count.
    """
    for i in range(cells.shape[0]):
        row = cells[i] // cols
        x = x0 + (cells[i] - row * cols + 0.5) * cell_m - eye_m[0]
        y = y0 + (row + 0.5) * cell_m - eye_m[1]
        away_m = math.sqrt(x * x + y * y)
        passes[i] = 0
        if away_m < NEAREST * cell_m:
            continue
        begin, end = bins_across(x, y, cell_m)
        for k in range(begin, end + 1):
            b = k & (BINS - 1)
            if far_m[b] < away_m + BEYOND * cell_m or clear_m[b] < away_m:
                continue
            for ray in range(first[b], first[b + 1]):
                if eye_m[2] + rise[ray] * away_m >= tops_m[i]:
                    break
                passes[i] += reach_m[ray] >= away_m + BEYOND * cell_m


@njit(cache=True, error_model="numpy")
def free_unseen(
    values: Any, blocks: Any, block_cols: int, factor: int, x0: float, y0: float, cell_m: float, eye_m: Any, low_m: Any
) -> None:
    """Fine cells of `blocks` (k,) of which nothing is known are free where a low ray goes on behind."""
    cols = block_cols * factor
    for i in range(blocks.shape[0]):
        first = (blocks[i] // block_cols) * factor * cols + (blocks[i] % block_cols) * factor
        for r in range(factor):
            for cell in range(first + r * cols, first + r * cols + factor):
                own = values[cell]
                if own[FREE_SHARE] > 0.0 or own[WALL_SHARE] > 0.0:
                    continue
                row = cell // cols
                x = x0 + (cell - row * cols + 0.5) * cell_m - eye_m[0]
                y = y0 + (row + 0.5) * cell_m - eye_m[1]
                if low_m[np.int32(direction(x, y) * PER_UNIT) & (BINS - 1)] >= math.sqrt(x * x + y * y):
                    own[FREE_SHARE] = 1.0
