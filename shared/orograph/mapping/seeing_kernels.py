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
GAP_MAX_M = 15.0
"""Over a wider gap nothing is ground: a wall that begins lower than the robot stands looks like it."""
NOISE_M = 0.05
"""Points less than this above each other are noise, not steepness."""


@njit(cache=True, error_model="numpy")
def direction(x: float, y: float) -> float:
    """0..4, growing counter-clockwise from east; NaN straight up and down. Without a branch, for many at once."""
    share = y / (abs(x) + abs(y))
    return 2.0 - share if x < 0.0 else (share + 4.0 if y < 0.0 else share)


@njit(cache=True, error_model="numpy")
def aim_rays(
    xyz: Any, eye_m: Any, beyond_m: float, rise_max: float, bins: Any, flat_m: Any, up: Any, clear_m: Any
) -> None:  # fmt: skip
    """Of points xyz (3, n) the bin of each one's ray, its reach [m], its rise [m/m] and how far it shows no house [m].

    That is `beyond_m` short of its end, before it is higher than LOW_M. Points that are not finite, or rise by more
    than `rise_max`, are of bin BINS. Without a branch, so that it runs on many points at once.
    """
    xs, ys, zs = xyz[0], xyz[1], xyz[2]
    eye_x, eye_y, eye_z = eye_m[0], eye_m[1], eye_m[2]
    for i in range(xs.shape[0]):
        x, y, z = xs[i] - eye_x, ys[i] - eye_y, zs[i] - eye_z
        flat, turn = math.sqrt(x * x + y * y), direction(x, y)
        good = (abs(turn) <= 4.0) & (abs(z) < math.inf) & (z <= rise_max * flat)
        b = np.int32((turn if good else 0.0) * PER_UNIT) & np.int32(BINS - 1)
        bins[i] = b if good else np.int32(BINS)
        rise, end_m = z / flat, flat - beyond_m
        low = LOW_M / rise if rise > 0.0 else end_m
        flat_m[i], up[i], clear_m[i] = flat, rise, low if low < end_m else end_m


@njit(cache=True)
def sort_rays(
    bins: Any, flat_m: Any, up: Any, clear_m: Any, first: Any, order: Any, reach_m: Any, rise: Any, low_m: Any,
    far_m: Any,
) -> None:  # fmt: skip
    """Rays (n,) by direction, and within one from the lowest up: bin b holds places `first[b]` to `first[b + 1]`.

    At a place stand the point's number, its horizontal reach [m] and its rise [m/m]. `low_m` (BINS,) becomes the
    longest `clear_m` (n,) of each bin, `far_m` the longest reach. Those of bin BINS are left out.

    By insertion, as lasers give their rings in order: from the last point on where they give the uppermost first.
    """
    n, one, falls = np.uint64(bins.shape[0]), np.uint64(1), 0.0
    first[:] = 0
    low_m[:] = 0.0
    far_m[:] = 0.0
    for i in range(n):
        first[bins[i] + one] += one
        if bins[i] < BINS:
            falls += up[i] if i + i < n else -up[i]
    for b in range(BINS):
        first[b + 1] += first[b]
    end, backwards = first[: BINS + 1].copy(), falls > 0.0
    for place in range(n):
        point: Any = n - one - place if backwards else place
        b, reach, own = bins[point], flat_m[point], up[point]
        if b == BINS:
            continue
        k, begin = end[b], first[b]
        end[b] = k + one
        while k > begin and (rise[k - one] > own or (backwards and rise[k - one] == own)):
            order[k], reach_m[k], rise[k] = order[k - one], reach_m[k - one], rise[k - one]
            k -= one
        order[k], reach_m[k], rise[k] = point, reach, own
        far_m[b], low_m[b] = max(far_m[b], reach), max(low_m[b], clear_m[point])


@njit(cache=True)
def find_raised(
    steepest: float, first: Any, order: Any, reach_m: Any, rise: Any, raised: Any, clear_m: Any
) -> None:  # fmt: skip
    """Mark in `raised` (n,) the points that are RAISED or UNCLEAR, direction by direction; the others are GROUND.

    `clear_m` (BINS,) becomes the reach of the nearest raised one of each direction.

    Raised: they lie one above the other on something steep, or over the ray to the last ground, or higher than a slope
    of `steepest` leads from there. Unclear: after a gap in which nothing was seen they may be either.
    """
    raised[:] = GROUND
    for b in range(BINS):
        ground_m, ground_z_m, trend, slope, upright, clear = 0.0, 0.0, 0.0, steepest, False, math.inf
        k, end = first[b], first[b + 1]
        while k < end:
            place, reach, own = k, reach_m[k], rise[k]
            z = own * reach  # over the eye
            away_m, over_m = abs(reach - ground_m), z - ground_z_m
            passed = reach < ground_m and z - ground_z_m * reach / ground_m > FOOT_M
            up = upright or passed or over_m > slope * away_m + NOISE_M
            k += np.uint64(1)
            upright = k < end and above(reach, own, z, reach_m[k], rise[k])
            if up or (upright and over_m > BEHIND * away_m + FOOT_M):
                raised[order[place]], slope = RAISED, BEHIND
                clear = min(clear, reach)
            elif unlike(over_m, away_m, trend) or (upright and over_m > FOOT_M):
                raised[order[place]] = UNCLEAR
            else:
                trend = max(over_m / away_m, 0.0) if away_m > FOOT_M else trend
                ground_m, ground_z_m = reach, z
        clear_m[b] = clear


@njit(cache=True)
def unlike(over_m: float, away_m: float, trend: float) -> bool:
    """Whether ground that leads there would be unlike what was seen of it, or nothing was seen of it for long."""
    return away_m > GAP_MAX_M or (away_m > GAP_M and over_m > (trend + UNLIKE) * away_m)


@njit(cache=True)
def above(low_m: float, low_rise: float, low_z_m: float, high_m: float, high_rise: float) -> bool:
    """Whether the second of two rays, in order of their rise, ends above the first on something steep."""
    up_m = high_rise * high_m - low_z_m
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
    values: Any, hit: Any, block_cols: int, factor: int, x0: float, y0: float, cell_m: float, eye_m: Any, low_m: Any
) -> None:
    """In the blocks of the fine cells `hit` (k,), cells of which nothing is known are free where a low ray goes on.

    No view of a cell's row is made: to count its references takes three times as long as all the rest.
    """
    cols, eye_x, eye_y = block_cols * factor, eye_m[0], eye_m[1]
    done = np.zeros(block_cols * block_cols, np.bool_)
    for i in range(hit.shape[0]):
        row = hit[i] // cols
        col = hit[i] - row * cols
        row, col = row // factor, col // factor
        if done[row * block_cols + col]:
            continue
        done[row * block_cols + col] = True
        for r in range(row * factor, (row + 1) * factor):
            y = y0 + (r + 0.5) * cell_m - eye_y
            for c in range(col * factor, (col + 1) * factor):
                cell, x = np.uint64(r * cols + c), x0 + (c + 0.5) * cell_m - eye_x
                goes_on = low_m[np.uint64(np.int32(direction(x, y) * PER_UNIT) & (BINS - 1))] >= math.sqrt(
                    x * x + y * y
                )
                if goes_on & (values[cell, FREE_SHARE] <= 0.0) & (values[cell, WALL_SHARE] <= 0.0):
                    values[cell, FREE_SHARE] = 1.0
