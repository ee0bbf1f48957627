"""What moves: clusters of cells that were free a moment ago, followed from map to map until their velocity is known."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy import ndimage

from orograph.arrays import F64
from orograph.geometry import wrap_angle
from orograph.layers import UNKNOWN_OCCUPATION
from orograph.messages import SECOND_NS, OccupancyGrid
from orograph.navigation.planner import BLOCKED
from orograph.navigation.planner_kernels import first_met

MOVER_CELLS = 2
"""Fewer cells together are noise."""
NEW_CELLS, NEW_M = 3, 3.0
"""So many cells so near to the path are heeded before it is known how they move."""
GATE_M = 3.0
"""So far from where it was expected, a cluster is still the same mover."""
LOST_NS = round(1.0 * SECOND_NS)
SURE = 3
"""Seen so many times, it moves; a wall that comes into sight does not go on for long."""
SLOWEST_MPS, FASTEST_MPS = 0.6, 15.0
NEWEST, NEWEST_SLOW = 0.6, 0.3
"""Weight of the newest displacement in the velocity; of what is slow, cells of half a metre tell less."""
TURNS_RADPS = 0.25, 1.5
"""It is thought to turn on, by a quarter at most, if it turns faster than the first; no faster than the second."""
TURNS_MPS = 2.5
"""Of what is slower the course is too coarsely known for that."""
AHEAD_S = np.arange(0.0, 5.01, 0.2)
"""Times at which a mover is foretold."""
REACH_M = 1.4
"""The robot's half diagonal, half a cell's, and half a metre."""
TOUCH_M = 0.7
"""So near the robot is touched, whichever side it turns to it."""
BEND_MPS2, BEND_MAX_M = 2.0, 4.0
"""Whatever drives may begin to turn at any time: so far it may come from its foretold way."""
HEAD_ON = 0.7
"""Cosine of the angle up to which two courses are against each other."""
POINTS_MAX = 40
ACCELERATION_MPS2, CRUISE_MPS = 1.2, 2.5
"""How the robot is thought to drive on."""


@dataclass(frozen=True, eq=False)
class Mover:
    """Cells (n, 2) [m] of its front when last seen, their middle, its velocity and turn, and how often it was seen."""

    stamp_ns: int
    cells_m: F64
    at_m: F64
    velocity_mps: F64
    turn_radps: float
    seen: int

    @property
    def speed_mps(self) -> float:
        """How fast it goes."""
        return math.hypot(*self.velocity_mps)

    @property
    def sure(self) -> bool:
        """Whether it is known to move, and how."""
        return self.seen >= SURE and SLOWEST_MPS <= self.speed_mps <= FASTEST_MPS

    def moved_m(self, times_s: F64) -> F64:
        """How far it is foretold to have come (n, 2) after times (n,)."""
        turning = abs(self.turn_radps) >= TURNS_RADPS[0] and self.speed_mps >= TURNS_MPS
        turned = np.clip((self.turn_radps if turning else 0.0) * times_s, -0.5 * math.pi, 0.5 * math.pi)
        heading = math.atan2(self.velocity_mps[1], self.velocity_mps[0]) + turned
        steps_s = np.diff(times_s, prepend=0.0)
        return np.cumsum(
            np.column_stack([np.cos(heading), np.sin(heading)]) * (self.speed_mps * steps_s)[:, None], axis=0
        )

    def expected_m(self, stamp_ns: int) -> F64:
        """Where its middle is by then (2,)."""
        expected: F64 = self.at_m + self.moved_m(np.array([(stamp_ns - self.stamp_ns) / SECOND_NS]))[0]
        return expected


class Meeting(NamedTuple):
    """Metres of path to where a mover is met, to the last place before it where it does not come, and to the first
    where it does; infinite where there is no such place, `wait_m` minus infinity.
    """

    met_m: float
    wait_m: float
    swept_m: float
    head_on: bool


class Movers:
    """Everything that moves near a robot, by its planning maps."""

    def __init__(self) -> None:
        self._movers: list[Mover] = []

    def take(self, new: OccupancyGrid, old: OccupancyGrid) -> None:
        """Follow what the newest map shows blocked that a map of a moment ago showed free."""
        waiting = [m for m in self._movers if new.stamp_ns - m.stamp_ns <= LOST_NS]
        found: list[Mover] = []
        for cells_m in clusters(appeared(new, old)):
            middle = cells_m.mean(axis=0)
            gaps = [math.dist(m.expected_m(new.stamp_ns), middle) for m in waiting]
            nearest = int(np.argmin(gaps)) if gaps else -1
            known = waiting.pop(nearest) if nearest >= 0 and gaps[nearest] <= _gate_m(waiting[nearest], new) else None
            found.append(_followed(known, new.stamp_ns, cells_m, middle))
        self._movers = found + waiting

    @property
    def sure(self) -> list[Mover]:
        """Those that are known to move."""
        return [m for m in self._movers if m.sure]

    def escapes(self, now_ns: int, path_m: F64, arc_m: F64, v_mps: float) -> bool:
        """Whether one would drive over a robot that stays, and not over one that goes on along its path (n, 2)."""
        times_s = arrival_s(arc_m, v_mps)
        for m in self.sure:
            way_m = m.moved_m(AHEAD_S + (now_ns - m.stamp_ns) / SECOND_NS)[None] + m.cells_m[:, None]
            comes = np.hypot(*(way_m - path_m[0]).transpose(2, 0, 1)).min(axis=0) < TOUCH_M
            away_m = np.hypot(*(path_m[:, None] - way_m.reshape(-1, 2)[None]).transpose(2, 0, 1)).min(axis=1)
            out = np.flatnonzero(away_m >= TOUCH_M)
            if comes.any() and len(out) and times_s[out[0]] <= AHEAD_S[np.argmax(comes)]:
                return True
        return False

    def appeared_m(self, path_m: F64, arc_m: F64, beyond_m: float) -> float:
        """Where beyond some metres a path (n, 2) leads past what has come and may move, who knows how; or infinity."""
        cells_m = [m.cells_m for m in self._movers if not m.sure and len(m.cells_m) >= NEW_CELLS]
        if not cells_m:
            return math.inf
        away_m = np.hypot(*(path_m[:, None, :] - np.concatenate(cells_m)[None, :, :]).transpose(2, 0, 1)).min(axis=1)
        return float(min(arc_m[(away_m <= NEW_M) & (arc_m >= beyond_m)], default=math.inf))

    def meetings(self, now_ns: int, path_m: F64, arc_m: F64, v_mps: float, careful: bool) -> list[Meeting]:
        """How each mover will come to a path (n, 2), `arc_m` (n,) ahead of the robot, that does.

        `careful` counts with movers that may begin to turn.
        """
        times_s = arrival_s(arc_m, v_mps)
        bend_m = np.minimum(0.5 * BEND_MPS2 * AHEAD_S**2, BEND_MAX_M) if careful else np.zeros(len(AHEAD_S))
        meetings = [_meeting(mover, now_ns, path_m, arc_m, times_s, REACH_M + bend_m) for mover in self.sure]
        return [m for m in meetings if m.swept_m < math.inf]


def _meeting(mover: Mover, now_ns: int, path_m: F64, arc_m: F64, times_s: F64, reach_m: F64) -> Meeting:
    cells_m = mover.cells_m[:: -(-len(mover.cells_m) // POINTS_MAX)]
    moved_m = mover.moved_m(AHEAD_S + (now_ns - mover.stamp_ns) / SECOND_NS)
    met, wait, swept = first_met(path_m, times_s, cells_m, AHEAD_S, moved_m, reach_m)
    along = path_m[swept] - path_m[max(0, swept - 2)]
    (x, y), (vx, vy) = along, mover.velocity_mps
    head_on = -float(x * vx + y * vy) > HEAD_ON * math.hypot(x, y) * mover.speed_mps
    return Meeting(
        float(arc_m[met]) if met >= 0 else math.inf, float(arc_m[wait]) if wait >= 0 else -math.inf,
        float(arc_m[swept]) if swept >= 0 else math.inf, head_on,
    )  # fmt: skip


def _gate_m(mover: Mover, new: OccupancyGrid) -> float:
    """What was seen only once may have gone any way."""
    return GATE_M if mover.seen > 1 else FASTEST_MPS * (new.stamp_ns - mover.stamp_ns) / SECOND_NS


def _followed(known: Mover | None, stamp_ns: int, cells_m: F64, middle: F64) -> Mover:
    if known is None:
        return Mover(stamp_ns, cells_m, middle, np.zeros(2), 0.0, 1)
    passed_s = (stamp_ns - known.stamp_ns) / SECOND_NS
    moved_mps, turn = (middle - known.at_m) / passed_s, 0.0
    if known.seen > 1 and known.speed_mps > 0.0:
        turned = wrap_angle(math.atan2(moved_mps[1], moved_mps[0]) - math.atan2(*known.velocity_mps[::-1]))
        turn = NEWEST * max(-TURNS_RADPS[1], min(TURNS_RADPS[1], turned / passed_s)) + (1 - NEWEST) * known.turn_radps
        newest = NEWEST if known.speed_mps >= TURNS_MPS else NEWEST_SLOW
        moved_mps = newest * moved_mps + (1.0 - newest) * known.velocity_mps
    return Mover(stamp_ns, cells_m, middle, moved_mps, turn, known.seen + 1)


def arrival_s(arc_m: F64, v_mps: float) -> F64:
    """When the robot gets to each place of its path, if nothing keeps it from speeding up."""
    v = max(0.0, v_mps)
    until_m = max(0.0, CRUISE_MPS**2 - v**2) / (2 * ACCELERATION_MPS2)
    speeding = (np.sqrt(v**2 + 2 * ACCELERATION_MPS2 * np.minimum(arc_m, until_m)) - v) / ACCELERATION_MPS2
    return speeding + np.maximum(0.0, arc_m - until_m) / max(v, CRUISE_MPS)


def appeared(new: OccupancyGrid, old: OccupancyGrid) -> OccupancyGrid:
    """The newest map's part that both show, with 1 where it is blocked and was free."""
    cell_m = new.cell_m
    col, row = round((new.x0_m - old.x0_m) / cell_m), round((new.y0_m - old.y0_m) / cell_m)
    rows, cols = (
        min(n, o - at) for n, o, at in zip(new.occupation.shape, old.occupation.shape, (row, col), strict=True)
    )
    first_row, first_col = max(0, -row), max(0, -col)
    now = new.occupation[first_row:rows, first_col:cols]
    then = old.occupation[first_row + row : rows + row, first_col + col : cols + col]
    came = (now >= BLOCKED) & (now != UNKNOWN_OCCUPATION) & (then < BLOCKED)
    x0, y0 = new.x0_m + first_col * cell_m, new.y0_m + first_row * cell_m
    return OccupancyGrid(new.stamp_ns, x0, y0, cell_m, False, came.astype(np.uint8))


def clusters(came: OccupancyGrid) -> list[F64]:
    """Centres (n, 2) [m] of the cells of each group with gaps of at most two cells, in the order of the map."""
    mask = came.occupation > 0
    if not mask.any():
        return []
    labels, _ = ndimage.label(ndimage.binary_dilation(mask, np.ones((3, 3))), np.ones((3, 3)))
    rows, cols = np.nonzero(mask)
    centres = np.column_stack([came.x0_m + (cols + 0.5) * came.cell_m, came.y0_m + (rows + 0.5) * came.cell_m])
    label = labels[rows, cols]
    groups = [centres[label == k] for k in np.unique(label)]
    return [group for group in groups if len(group) >= MOVER_CELLS]
