"""Which pictures a run's report has, each drawn only where the run left what it shows."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from orograph import keys
from orograph.arrays import F64
from orograph.geometry import laser_position_m, ray_directions, rotation_from_quaternion
from orograph.grid import Grid
from orograph.judge.improvement import prior_over
from orograph.judge.summary import Verdict, glrm_errors
from orograph.layers import CONFIDENT, CellMap
from orograph.points import points_from_ranges
from orograph.report import curves, maps, surfaces
from orograph.report.axonometric import Relief
from orograph.report.palette import Picture
from orograph.scenario import Scenario
from orograph.sensing.truth import top_surface
from orograph.storage.parts import RunParts

AROUND_M = 50.0
"""Half a side of the scene picture."""
SCENE_CELL_M = 0.5
MANY_EVENTS = 400
"""A timeline with more marks than this says nothing; the commonest kinds are left out first."""


@dataclass(frozen=True)
class Gallery:
    """The report's pictures, None where the run left nothing to draw."""

    paths: Picture | None
    coverage: Picture | None
    timeline: Picture | None
    initial_glrm: Picture
    final_glrm: Picture
    changes: Picture
    surface_changes: Picture | None
    layers: Picture
    scene: Picture | None
    initial_hrm: Picture | None
    final_hrm: Picture | None
    errors: Picture
    by_confidence: Picture
    pose: Picture | None


def gallery(parts: RunParts, verdict: Verdict) -> Gallery:
    """Draw everything."""
    extent = maps.shown_extent(verdict.glrm.grid, verdict.glrm.confidence >= CONFIDENT)
    initial_glrm, final_glrm = _glrm_surfaces(verdict, extent)
    initial_hrm, final_hrm = _hrm_surfaces(parts)
    scores = {"Global map": verdict.summary.score.glrm, "Local maps": verdict.summary.score.hrm}
    return Gallery(
        paths=_paths(parts, verdict, extent),
        coverage=_coverage(parts, verdict),
        timeline=_timeline(parts),
        initial_glrm=initial_glrm,
        final_glrm=final_glrm,
        changes=_changes(parts, verdict, extent),
        surface_changes=_surface_changes(verdict, extent),
        layers=maps.occupation_and_confidence(verdict.glrm, extent),
        scene=_scene(parts, verdict),
        initial_hrm=initial_hrm,
        final_hrm=final_hrm,
        errors=maps.height_error(verdict.glrm.grid, *glrm_errors(verdict), extent),
        by_confidence=curves.error_by_confidence(scores),
        pose=_pose(parts, verdict),
    )


def _paths(parts: RunParts, verdict: Verdict, extent: tuple[float, ...]) -> Picture | None:
    if not verdict.tracks:
        return None
    paths = {robot: (track.position_m, track.radio) for robot, track in verdict.tracks.items()}
    world = parts.of(keys.WORLD)
    vehicles = [world[name][:, 1:3] for name in sorted(world) if name.startswith("vehicle_")]
    patrol, base = np.array(parts.scenario.patrol), parts.scenario.base_station_m
    return maps.robot_paths(verdict.glrm, verdict.glrm.communications, paths, vehicles, patrol, base, extent)


def _coverage(parts: RunParts, verdict: Verdict) -> Picture | None:
    first = parts.of(keys.MANAGER).get("first_confident_ns")
    if first is None or not verdict.observable_cells:
        return None
    reached = np.sort(first.reshape(-1)[verdict.reference.observable.reshape(-1)])
    reached = reached[reached >= 0] / 1e9
    time_s = np.concatenate([[0.0], reached, [max(parts.run.sim_time_s, reached.max(initial=0.0))]])
    share = np.concatenate([[0.0], np.arange(1, reached.size + 1), [reached.size]]) / verdict.observable_cells
    silent = {robot: track.silences_s() for robot, track in verdict.tracks.items()}
    return curves.coverage(
        time_s,
        share,
        verdict.summary.mapping_time_s,
        silent,
        _backlog(parts),
        parts.run.sim_time_s,
        parts.phase_began_s("flush"),
    )


def _backlog(parts: RunParts) -> dict[str, tuple[npt.NDArray[Any], npt.NDArray[Any]]]:
    series = {robot: parts.of(keys.MAPPING, robot).get("backlog") for robot in parts.robots}
    return {robot: (b[:, 0] / 1e9, b[:, 1].astype(float)) for robot, b in series.items() if b is not None and len(b)}


def _timeline(parts: RunParts) -> Picture | None:
    events = list(parts.events)
    while len(events) > MANY_EVENTS:
        kinds = [str(e.get("event")) for e in events]
        commonest = max(sorted(set(kinds)), key=kinds.count)
        events = [e for e, kind in zip(events, kinds, strict=True) if kind != commonest]
    if not events:
        return None
    lanes = sorted({curves.lane_of(e) for e in events}, key=lambda lane: (lane.startswith("robot_"), lane))
    return curves.timeline(events, lanes, max(parts.run.sim_time_s, 1.0))


def _glrm_surfaces(verdict: Verdict, extent: tuple[float, ...]) -> tuple[Picture, Picture]:
    """Where the robots were: over a whole district what they changed would be too small to see."""
    grid, shown = maps.window_of(verdict.glrm.grid, extent)
    first, last = verdict.prior.visible[shown], verdict.glrm.visible[shown]
    limits = surfaces.height_limits(first, last)
    times = _exaggeration(grid)
    told = f"Heights [m] drawn {times:g} times too tall." if times != 1 else "Heights [m], true proportions."
    one = Relief(grid, first.astype(np.float64), times)
    two = Relief(grid, last.astype(np.float64), times)
    flat = "Before the first scan: nothing is known."
    if verdict.prior.known.any():
        flat = "Before the first scan: the ground is known, and every building is drawn at one height."
    found = "At the end: streets that were driven have measured heights, façades stand as high as the lasers saw them."
    alike = "Oblique view of the initial global height map; all buildings equally high."
    unlike = "Oblique view of the final global height map; buildings of different heights."
    return (
        surfaces.surface(one, limits, f"{flat} {told}", alike),
        surfaces.surface(two, limits, f"{found} {told}", unlike),
    )


def _changes(parts: RunParts, verdict: Verdict, extent: tuple[float, ...]) -> Picture:
    robot = parts.robots[0]
    local = parts.hrm(robot)
    own = None if local is None else (local.grid, local.visible - prior_over(verdict.prior, local.grid).visible)
    return maps.changes(verdict.glrm.grid, verdict.glrm.visible - verdict.prior.visible, extent, robot, own)


def _surface_changes(verdict: Verdict, extent: tuple[float, ...]) -> Picture | None:
    changes = verdict.summary.surface_changes
    return maps.surface_changes(verdict.glrm, changes, extent) if changes else None


def _exaggeration(grid: Grid) -> float:
    """So that 10 m stay visible on a large district: 1 up to 600 m, 2 at 1 km."""
    x0, y0, x1, y1 = grid.extent_m
    return float(np.clip(round(max(x1 - x0, y1 - y0) / 400.0), 1, 6))


def _hrm_surfaces(parts: RunParts) -> tuple[Picture | None, Picture | None]:
    robot = parts.robots[0]
    first, last = parts.initial_hrm_height(robot), parts.hrm(robot)
    layers = [*([first[1]] if first else []), *([last.visible] if last else [])]
    limits = surfaces.height_limits(*layers) if layers else (0.0, 1.0)
    one = two = None
    if first is not None:
        caption = f"{robot}'s local map before its first scan: the global prior, cut into finer cells. Heights [m]."
        relief = Relief(first[0], first[1].astype(np.float64))
        one = surfaces.surface(
            relief, limits, caption, f"Oblique view of {robot}'s initial local height map: blocks of equal height."
        )
    if last is not None:
        two = _final_hrm(robot, last, limits)
    return one, two


def _final_hrm(robot: str, hrm: CellMap, limits: tuple[float, float]) -> Picture:
    caption = (
        f"{robot}'s local map at the end, around where it stopped: its own evidence over the prior. Walls are as high "
        f"as the laser "
        "saw them, and what it never saw keeps the prior. Heights [m]."
    )
    relief = Relief(hrm.grid, hrm.visible.astype(np.float64))
    return surfaces.surface(
        relief, limits, caption, f"Oblique view of {robot}'s final local height map with sharp walls."
    )


def _scene(parts: RunParts, verdict: Verdict) -> Picture | None:
    robot = parts.robots[0]
    laser = parts.of(keys.LASER, robot)
    if "last_ranges" not in laser or not np.any(laser["last_ranges"]):
        return None
    x, y = (float(v) for v in laser["last_position_m"][:2])
    side = 2 * round(AROUND_M / SCENE_CELL_M)
    grid = Grid((x - AROUND_M, y - AROUND_M), SCENE_CELL_M, (side, side))
    height, _ = top_surface(verdict.scene, grid, 2)
    points = _last_points(parts.scenario, laser)
    near = points[np.abs(points[:, :2] - (x, y)).max(axis=1) < AROUND_M]
    relief = Relief(grid, height.astype(np.float64))
    return surfaces.scene_with_points(relief, near, laser["last_position_m"], surfaces.height_limits(height), robot)


def _last_points(scenario: Scenario, laser: Any) -> F64:
    R_map_robot = rotation_from_quaternion(laser["last_quaternion_wxyz"])
    eye_m = laser_position_m(scenario.laser, R_map_robot, laser["last_position_m"])
    points, _ = points_from_ranges(laser["last_ranges"], ray_directions(scenario.laser), R_map_robot, eye_m)
    return points


def _pose(parts: RunParts, verdict: Verdict) -> Picture | None:
    errors = {robot: track.pose_error_m for robot, track in verdict.tracks.items() if len(track.pose_error_m[0])}
    return curves.pose_errors(errors, parts.run.sim_time_s) if errors else None
