"""The reference: what the same rules give from noise-free dense scans along the patrol, moving bodies absent.

It depends on the scenario and its number of robots alone, not on the run: each drives its share of the
patrol, as it is split at the start, the way the navigator plans it over a prior without errors; a scan every SPACING_M,
no stretch twice. The clock runs at the robot's top speed.
"""

from __future__ import annotations

import hashlib
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from orograph.arrays import F64, Mask
from orograph.grid import Grid
from orograph.judge.provenance import code_digest
from orograph.judge.route import patrol_poses
from orograph.layers import BASIC_LAYERS, CONFIDENT, LAYERS, CellMap
from orograph.mapping import RobotMapper
from orograph.protocol.fold import fold_registers, whole_prior
from orograph.registers import of_robot, unpack
from orograph.rules import Rules
from orograph.scenario import NavigationSensorsSpec, PriorSpec, RadioSpec, Scenario
from orograph.scene import build_scene
from orograph.scene.prior import given_layers, prior_records
from orograph.sensing.truth import dense_scans
from orograph.storage.run_folder import write_arrays

UNSEEN = {
    "name": "reference", "title": "reference", "attribution": "", "crs": "", "crs_origin_m": (0.0, 0.0), "seed": 0,
    "duration_max_s": 600.0, "time_scale": "max", "frame_ms": 100, "vehicles": (), "base_station_m": (0.0, 0.0),
    "navigation_sensors": NavigationSensorsSpec(), "radio": RadioSpec(),
}  # fmt: skip
"""What the reference does not depend on, as it is always built: neither these nor their changes can move it."""
KEPT_MAX = 30
"""Kept references; the oldest go."""
SPACING_M = 2.0
DENSITY = 1
"""Rings and columns as the scenario's own laser has them: a robot scans about every metre, so what this sparser pass
makes confident is what a robot that drives by can make confident too."""


@dataclass(frozen=True, eq=False)
class Reference:
    """The ideal maps of a scenario and the way they were scanned from."""

    glrm: CellMap
    hrm: CellMap
    """All that was ever seen at high resolution, over the rectangle that encloses it; aligned with the GLRM."""
    poses: F64
    """(n, 3) x [m], y [m], yaw [rad] of the scans."""

    @property
    def observable(self) -> Mask:
        """GLRM cells that can be mapped from the patrol."""
        return self.glrm.confidence >= CONFIDENT

    def hrm_over(self, grid: Grid) -> CellMap:
        """The high-resolution reference over another aligned grid of the same cell, unknown outside."""
        out = CellMap.unknown(grid)
        _paste(out, self.hrm)
        return out


def cached(scenario: Scenario, cache: Path) -> Reference:
    """The reference of a scenario, from the folder `cache` where the same code has made it before."""
    seen = scenario.model_copy(update={**UNSEEN, "prior": _without_errors(scenario.prior)})
    name = hashlib.blake2b((code_digest(__name__) + seen.model_dump_json()).encode(), digest_size=16).hexdigest()
    kept = cache / f"reference-{name}.npz"
    if kept.exists():
        return _load(kept, scenario)
    reference = build(seen)
    # A cache that cannot be written, as in a read-only container, costs time and nothing else.
    with suppress(OSError):
        _save(kept, reference)
        for old in sorted(cache.glob("reference-*.npz"), key=lambda path: path.stat().st_mtime)[:-KEPT_MAX]:
            old.unlink()
    return reference


def _without_errors(prior: PriorSpec) -> PriorSpec:
    """A way planned where a house is missing leads through it, and shows what nobody can see."""
    return PriorSpec(building_height_m=prior.building_height_m)


def build(scenario: Scenario) -> Reference:
    """Drive the reference route and map it."""
    poses = patrol_poses(scenario, SPACING_M)
    given = given_layers(scenario)
    mapper = RobotMapper(
        scenario.grid.grid, scenario.hrm.cells, scenario.hrm.per_glrm_cell, Rules.of(scenario.rules),
        scenario.laser.range_max_m, scenario.robot.slope_max, given,
    )  # fmt: skip
    whole = CellMap.unknown(scenario.grid.grid.refined(scenario.hrm.per_glrm_cell))
    between_ns = round(SPACING_M / scenario.robot.speed_max_mps * 1e9)
    for k, (points, ranges_m, position) in enumerate(dense_scans(build_scene(scenario), poses, DENSITY)):
        mapper.step(points, ranges_m, position, k * between_ns)
        _keep_best(whole, mapper.evidence)
    return Reference(_glrm(scenario, mapper, given), _cropped(whole), poses)


def _glrm(scenario: Scenario, mapper: RobotMapper, given: tuple[Any, Any]) -> CellMap:
    grid = scenario.grid.grid
    registers = of_robot(1, mapper.registers())
    prior = whole_prior(prior_records(scenario), grid.size)
    glrm = unpack(fold_registers(prior, registers, Rules.of(scenario.rules)), grid, *given)
    return CellMap(grid, {name: glrm.by_name[name] for name in LAYERS})


def _overlap(into: Grid, source: Grid) -> tuple[tuple[slice, slice], tuple[slice, slice]]:
    """Index ranges of the common rectangle in both of two aligned grids of one cell."""
    row = round((source.origin_m[1] - into.origin_m[1]) / into.cell_m)
    col = round((source.origin_m[0] - into.origin_m[0]) / into.cell_m)
    row0, row1 = max(row, 0), max(max(row, 0), min(row + source.rows, into.rows))
    col0, col1 = max(col, 0), max(max(col, 0), min(col + source.cols, into.cols))
    mine = slice(row0, row1), slice(col0, col1)
    return mine, (slice(row0 - row, row1 - row), slice(col0 - col, col1 - col))


def _paste(into: CellMap, source: CellMap) -> None:
    mine, theirs = _overlap(into.grid, source.grid)
    for name in BASIC_LAYERS:
        getattr(into, name)[mine] = getattr(source, name)[theirs]


def _keep_best(whole: CellMap, evidence: CellMap) -> None:
    """What rolled out and comes back from the coarse map must not blur what was seen finely: the surer cell stays."""
    mine, theirs = _overlap(whole.grid, evidence.grid)
    better = evidence.confidence[theirs] >= np.maximum(whole.confidence[mine], 1e-6)
    for name in BASIC_LAYERS:
        layer = getattr(whole, name)[mine]
        layer[better] = getattr(evidence, name)[theirs][better]


def _cropped(whole: CellMap) -> CellMap:
    rows, cols = np.nonzero(whole.known)
    if not rows.size:
        return CellMap.unknown(whole.grid.window(0, 0, (1, 1)))
    shape = (int(np.ptp(rows)) + 1, int(np.ptp(cols)) + 1)
    out = CellMap.unknown(whole.grid.window(int(rows.min()), int(cols.min()), shape))
    _paste(out, whole)
    return out


def _save(path: Path, reference: Reference) -> None:
    arrays: dict[str, Any] = {"poses": reference.poses, "hrm_origin_m": np.array(reference.hrm.grid.origin_m)}
    for name in BASIC_LAYERS:
        arrays[f"glrm_{name}"] = getattr(reference.glrm, name)
        arrays[f"hrm_{name}"] = getattr(reference.hrm, name)
    write_arrays(path, arrays)


def _load(path: Path, scenario: Scenario) -> Reference:
    with np.load(path, allow_pickle=False) as kept:
        glrm = CellMap.unknown(scenario.grid.grid)
        x0, y0 = (float(v) for v in kept["hrm_origin_m"])
        rows, cols = kept["hrm_height"].shape
        hrm = CellMap.unknown(Grid((x0, y0), scenario.grid.cell_m / scenario.hrm.per_glrm_cell, (rows, cols)))
        for name in BASIC_LAYERS:
            getattr(glrm, name)[...] = kept[f"glrm_{name}"]
            getattr(hrm, name)[...] = kept[f"hrm_{name}"]
        gps_quality, communications = given_layers(scenario)
        glrm.gps_quality[...], glrm.communications[...] = gps_quality, communications
        return Reference(glrm, hrm, kept["poses"])
