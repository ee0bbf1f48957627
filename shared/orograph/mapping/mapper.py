"""A robot's mapping, from a scan to the cells worth sending (the paper's Fig. 8; mapping.md section 4)."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import numpy.typing as npt

from orograph.arrays import F32, F64, U1
from orograph.grid import Grid
from orograph.layers import HEIGHT_TOP, CellMap
from orograph.mapping.cells import Cells, Given, Values, cut, map_of, unknown_values
from orograph.mapping.door import (
    RANGE_MIN_M,
    ScanClock,
    beyond,
    checked_points,
    checked_position,
    checked_ranges,
    laser_height_m,
    positive,
)  # fmt: skip
from orograph.mapping.evidence import Evidence
from orograph.mapping.fusion import fuse, lay_over
from orograph.mapping.occupancy import Codes, OccupancyView
from orograph.mapping.reconstruction import DROP_REASONS, Reconstructor
from orograph.mapping.reconstruction_kernels import count_beyond
from orograph.mapping.rescaling import expand, rescale
from orograph.mapping.seeing import Rays
from orograph.mapping.seeing_kernels import BINS
from orograph.mapping.surface_kernels import STEP
from orograph.mapping.updates import moved
from orograph.messages import RANGE_UNIT_M, Packed
from orograph.points import points_from_ranges
from orograph.registers import has_evidence, pack, values
from orograph.rules import SLOPE_MAX, Rules
from orograph.stages import Stage, untimed

FINE_KEPT = 20_000
"""Blocks that rolled out and come back whole: half a square kilometre of 5 m blocks, 90 MB."""
GRAZING_M = 0.02
"""A ray that passes no more than this over the top that was seen would have hit it, if it were there."""
SILENT_RISE = 0.1
"""Rays without a return count as passing everything, as long as they rise by no more than this per metre."""
NO_RAYS, EVERYWHERE = np.zeros((3, 0)), np.full(BINS, np.inf)


class RobotMapper:
    """Own evidence in a rolling HRM, its LLRM, and which of its cells others should hear of."""

    def __init__(
        self, glrm_grid: Grid, hrm_cells: int, per_glrm_cell: int, rules: Rules, range_max_m: float,
        slope_max: float = SLOPE_MAX, given: Given | None = None, stage: Stage = untimed,
        range_min_m: float = RANGE_MIN_M, keep_fine: bool = False,
    ) -> None:  # fmt: skip
        """`given`: the GLRM's gps_quality and communications layers; `stage` times the rows of the paper's Table 2.

        Points nearer than `range_min_m` are no surface; raises ValueError for ranges and slopes that cannot be. With
        `keep_fine` all HRM cells are kept, on the GLRM or off it; else, by rules of two surfaces, FINE_KEPT blocks.
        """
        positive("slope_max", slope_max)
        fine_kept = math.inf if keep_fine else FINE_KEPT if rules.two_surfaces else 0
        self._evidence, self._keep_fine = Evidence(glrm_grid, hrm_cells, per_glrm_cell, fine_kept), keep_fine
        self._reconstructor = Reconstructor(
            hrm_cells**2, positive("range_max_m", range_max_m), rules.real(slope_max), stage
        )
        self._rays, self._silent, self._cell_m = Rays(), Rays(), glrm_grid.cell_m / per_glrm_cell
        self._silent_units = np.uint16(min(range_max_m / RANGE_UNIT_M, 2**16 - 1))
        self._rules, self._slope_max, self._stage = rules, slope_max, stage
        self._given = map_of(unknown_values(glrm_grid.size), glrm_grid, given)
        self._fine_rules, self._coarse_rules = rules.real(slope_max), rules.real(None)
        self._planning = OccupancyView(self._evidence, self._fine_rules)
        self._range_min_m, self._clock = range_min_m, ScanClock()
        self._below_range = self._outside_map = 0

    def step(
        self, points: npt.ArrayLike, ranges_m: npt.ArrayLike, position_m: npt.ArrayLike, stamp_ns: int,
        held: Packed | None = None,
    ) -> Packed:  # fmt: skip
        """Map one scan: points (n, 3) [m, map frame] measured at ranges (n,) [m]; returns the UpdatedCellsList.

        The HRM follows `position_m`, the laser's place (x, y, z), or (x, y) where the ranges tell its height; without
        that, rules of two surfaces do not see what rays pass through. `stamp_ns` is of any clock that counts
        nanoseconds. The list (UPDATE, ascending cells, seq 0) has the touched cells that are away enough from what the
        receiver holds, each with the robot's whole evidence for it (mapping.md section 4). `held` (cells of the GLRM,)
        are the receiver's registers, UPDATE or REGISTER, with confidence 0 where it holds none; None is nothing at all.
        Raises ValueError for what is no scan.
        """
        points = checked_points(points)
        points, ranges_m, dropped = beyond(points, checked_ranges(ranges_m, len(points)), self._range_min_m)
        self._below_range += dropped
        x_m, y_m = checked_position(position_m)
        eye_m = np.asarray(position_m, np.float64)
        if len(eye_m) == 2 and self._rules.two_surfaces:
            eye_m = np.array([x_m, y_m, laser_height_m(points, ranges_m, x_m, y_m)])
        self._silent.sort(NO_RAYS, eye_m, self._cell_m)
        return self._map(points, ranges_m, eye_m, self._clock.tick(stamp_ns), held)

    def _map(
        self, points: npt.NDArray[Any], ranges_m: npt.NDArray[Any], eye_m: F64, tick: int, held: Packed | None
    ) -> Packed:
        evidence = self._evidence
        self.roll_to(eye_m)
        self._count_outside_map(points)
        raised = self._raised(points, eye_m)
        cells, aux, kinds = self._reconstructor.aux(points, ranges_m, evidence.grid, evidence.values, raised)
        with self._stage("fuse_hrm"):
            evidence.fuse_scan(cells, aux, kinds, tick, self._fine_rules)
            if self._rules.two_surfaces:
                cells = self._see_through(eye_m, cells, kinds, tick)
        with self._stage("rescale"):
            touched = self._registers_of(evidence.rescale(cells))
            return np.compress(has_evidence(touched) if held is None else moved(touched, held), touched)

    def step_scan(
        self,
        ranges: npt.NDArray[Any],
        directions: F32,
        R_map_robot: F64,
        laser_position_m: npt.ArrayLike,
        stamp_ns: int,
        held: Packed | None = None,
    ) -> Packed:
        """The same from a range image (u2, RANGE_UNIT_M) and the laser's pose in the map frame; the HRM follows it."""
        with self._stage("points"):
            points, ranges_m = points_from_ranges(ranges, directions, R_map_robot, laser_position_m)
        eye_m = np.asarray(laser_position_m, np.float64)
        if self._rules.two_surfaces:
            silent, _ = points_from_ranges(np.where(ranges == 0, self._silent_units, 0), directions, R_map_robot, eye_m)
            self._silent.sort(silent.T, eye_m, self._cell_m, rise_max=SILENT_RISE)
        return self._map(points, ranges_m, eye_m, stamp_ns // 1_000_000, held)

    def _count_outside_map(self, points: npt.NDArray[Any]) -> None:
        """Points in the HRM and beyond the GLRM are mapped as long as they are in sight, and lost to everybody else."""
        if self._keep_fine:
            return
        window, whole = self._evidence.grid.extent_m, self._evidence.glrm.extent_m
        if window[0] >= whole[0] and window[1] >= whole[1] and window[2] <= whole[2] and window[3] <= whole[3]:
            return
        self._outside_map += count_beyond(points.T, window, whole)

    def _raised(self, points: npt.NDArray[Any], eye_m: F64) -> U1:
        if not self._rules.two_surfaces or not _has_height(eye_m):
            return np.zeros(len(points), np.uint8)
        self._rays.sort(np.ascontiguousarray(points.T, np.float64), eye_m, self._cell_m)
        return self._rays.raised(len(points), self._rules.step_m / self._cell_m)

    def _see_through(self, eye_m: F64, cells: Cells, kinds: U1, tick: int) -> Cells:
        """Free what rays passed through and keep the scan's obstacles for planning; all cells that may have changed."""
        evidence, hit = self._evidence, cells[kinds == STEP]
        self._planning.show(tick, hit)
        if not _has_height(eye_m):
            return cells
        stands, grid = evidence.standing_but(hit), evidence.grid
        tops_m = evidence.values[stands, HEIGHT_TOP] + np.float32(GRAZING_M)
        passes = self._rays.passes(eye_m, grid, stands, tops_m, EVERYWHERE)
        passes += self._silent.passes(eye_m, grid, stands, tops_m, self._rays.clear_m)
        self._rays.free_unseen(evidence.values, hit, evidence.factor, grid, eye_m)
        return np.concatenate([cells, evidence.clear_passed(stands, passes, self._fine_rules)])

    def adopt(self, row: Packed, fuse: bool) -> None:
        """Take over the robot's own row as the Map Manager holds it (REGISTER).

        With `fuse` the row is of an earlier life and is fused with what was seen since; without, it only fills gaps.
        """
        row = row[has_evidence(row)]
        cells = row["cell"].astype(np.int64)
        told = values(row).astype(np.float32)
        ticks = row["tick"].astype(np.uint32)
        if fuse:
            self._evidence.fuse_coarse(cells, told, ticks, self._fine_rules, self._coarse_rules)
        else:
            missing = ~np.isin(cells, self._evidence.known_cells())
            self._evidence.put(cells[missing], told[missing], ticks[missing])

    def registers(self) -> Packed:
        """All own evidence as registers (UPDATE, ascending cells, seq 0)."""
        return self._registers_of(self._evidence.known_cells())

    @property
    def evidence(self) -> CellMap:
        """The HRM of own evidence alone."""
        given = expand(self._cut(self._given), self._evidence.factor)
        return map_of(self._evidence.values, self._evidence.grid, (given.gps_quality, given.communications))

    def fine(self) -> CellMap:
        """Every HRM cell of own evidence; asserts `keep_fine` and that there was a scan."""
        grid, values = self._evidence.fine()
        return map_of(values, grid)

    @property
    def fine_blocks(self) -> tuple[int, int]:
        """How many GLRM cells high and wide `fine` is at most."""
        return self._evidence.fine_blocks

    def llrm(self) -> CellMap:
        """The HRM's area on GLRM cells, own evidence alone."""
        return rescale(self.evidence, self._evidence.factor)

    def hrm(self, prior: CellMap) -> CellMap:
        """The HRM that others see: own evidence fused over the GLRM `prior` under it, as far as that reaches."""
        under = expand(self._cut(prior), self._evidence.factor)
        return (lay_over if self._rules.two_surfaces else fuse)(under, self.evidence, self._rules, self._slope_max)

    def planning_occupation(self, prior: Values, told: Codes) -> Codes:
        """Occupation codes (rows, cols): of `hrm` over `prior`; of `told` (codes) where there is no evidence.

        Prior (cells, WIDTH) and told (cells,) are whole GLRMs; nobody writes into `prior` afterwards. `told` may hold
        this robot's own evidence: it is never fused with it.
        """
        return self._planning.codes(prior, told)

    @property
    def hrm_grid(self) -> Grid:
        """Where the HRM is now; asserts that it has been placed."""
        return self._evidence.grid

    @property
    def dropped(self) -> dict[str, int]:
        """Points dropped so far by reason; `outside_map`: kept in the HRM alone, as the GLRM ends before them."""
        reconstructed = dict(zip(DROP_REASONS, self._reconstructor.dropped.tolist(), strict=True))
        return {**reconstructed, "below_range": self._below_range, "outside_map": self._outside_map}

    @property
    def clock_restarts(self) -> int:
        """How often the scans' clock was set back."""
        return self._clock.restarts

    def roll_to(self, position_xy_m: npt.ArrayLike) -> None:
        """Bring the HRM's centre within one GLRM cell of a position [m, map frame]; `step` does it by itself."""
        x_m, y_m = np.asarray(position_xy_m, np.float64)[:2].tolist()
        self._evidence.roll_to(x_m, y_m)

    def _cut(self, glrm: CellMap) -> CellMap:
        assert self._evidence.window is not None, "no scan yet"
        return cut(glrm, *self._evidence.window, self._evidence.llrm_grid.shape)

    def _registers_of(self, cells: Cells) -> Packed:
        return pack(cells, self._evidence.coarse_ticks[cells], self._evidence.coarse[cells])


def _has_height(eye_m: F64) -> bool:
    """Whether the laser's place came with its z, so that its rays are known."""
    return len(eye_m) > 2 and bool(np.isfinite(eye_m[2]))
