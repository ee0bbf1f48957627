"""A made-up run with realistic maps: what a report is tested on without driving anybody anywhere."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
from orograph import keys
from orograph.grid import Grid
from orograph.judge.map_score import JUDGED, map_figures
from orograph.judge.score import height_error
from orograph.layers import BASIC_LAYERS, CellMap
from orograph.mapping.cells import values_of
from orograph.messages import POSE, REGISTER, ROBOT_REGISTER
from orograph.protocol.fold import fold_registers, whole_prior
from orograph.registers import pack, unpack
from orograph.rules import Rules
from orograph.scenario import Scenario
from orograph.scene import Scene, build_scene
from orograph.scene.prior import prior_records
from orograph.sensing import Laser, RangeImager
from orograph.sensing.truth import top_surface
from orograph.stages import STAGES
from orograph.storage import run_folder
from orograph.storage.parts import RunParts
from orograph.storage.recording import Recording
from orograph.storage.results import (
    Improvement,
    Improvements,
    Machine,
    MapFigures,
    MapScore,
    MapScores,
    PriorAndFinal,
    RunInfo,
    Scores,
    Summary,
    WorldResult,
)  # fmt: skip

LENGTH_S = 60


def city(robots: int = 2, rows: int = 32) -> Scenario:
    """Square blocks of differing heights between streets 20 m wide, a radio shadow in the middle."""
    side = rows * 5.0
    starts_of_blocks = np.arange(20.0, side - 29.0, 50.0)
    buildings = [
        {"footprint": [[x, y], [x + 30, y], [x + 30, y + 30], [x, y + 30]], "height_m": 4.0 + (7 * i + 3 * j) % 11}
        for i, x in enumerate(starts_of_blocks)
        for j, y in enumerate(starts_of_blocks)
    ]
    return Scenario.model_validate(
        {
            "name": "city", "title": "A made-up city", "robots": robots, "buildings": buildings,
            "attribution": "Drawn by the tests <b>themselves</b>.",
            "grid": {"rows": rows, "cols": rows}, "hrm": {"cells": 120}, 
            "laser": {"rings": 12, "columns": 180, "range_max_m": 40},
            "terrain": {"height_m": 8.0, "waves": [{"amplitude_m": 1.0, "wavelength_m": 120.0, "heading_deg": 30.0}]},
            "communications": {"default": 1, "areas": [{"rectangle_m": [50, 50, 90, 90], "value": 0}]},
            "starts": [{"x_m": 10.0, "y_m": 10.0}, {"x_m": side - 10.0, "y_m": side - 10.0}],
            "base_station_m": [10.0, 5.0],
            "patrol": [[60.0, 10.0], [60.0, 60.0], [110.0, 60.0], [110.0, 110.0]],
        }
    )  # fmt: skip


def way(scenario: Scenario, index: int) -> np.ndarray[Any, Any]:
    """A robot's positions (600, 2) along half of the patrol."""
    start = scenario.starts[index]
    stops = np.array([(start.x_m, start.y_m), *(scenario.patrol if index == 0 else scenario.patrol[::-1])])
    along = np.linspace(0, len(stops) - 1, LENGTH_S * 10)
    return np.stack([np.interp(along, np.arange(len(stops)), stops[:, i]) for i in (0, 1)], axis=1)


def seen_map(scene: Scene, grid: Grid, path: np.ndarray[Any, Any], seed: int) -> CellMap:
    """The true surface with 5 cm of noise within 30 m of a path, surer where nearer."""
    height, occupied = top_surface(scene, grid, 2)
    out = CellMap.unknown(grid)
    x, y = np.meshgrid(*grid.centres_m())
    near = np.min(np.hypot(x[..., None] - path[::20, 0], y[..., None] - path[::20, 1]), axis=-1)
    sure = np.clip(np.round(255 * (1 - near / 30.0)), 0, 255)
    noise = np.random.default_rng(seed).normal(0.0, 0.05, grid.shape)
    known = sure > 0
    out.confidence[...] = sure
    for name, value in (
        ("height", height + noise),
        ("gradient_x", 0 * height),
        ("gradient_y", 0 * height),
        ("occupation", occupied),
    ):
        getattr(out, name)[known] = np.asarray(value, np.float32)[known]
    return out


def registers_of(cells: CellMap, tick_ms: int) -> np.ndarray[Any, Any]:
    """A map's cells as one robot's registers of epoch 1."""
    known = np.flatnonzero(cells.known)
    records = pack(known, tick_ms, values_of(cells)[known])
    rows = np.zeros(len(records), REGISTER)
    for name in records.dtype.names or ():
        rows[name] = records[name]
    rows["epoch"], rows["seq"] = 1, 1 + np.arange(len(rows))
    return rows


def mapping_artifacts(scenario: Scenario, scene: Scene, index: int) -> dict[str, Any]:
    """What a robot's mapping would leave."""
    path = way(scenario, index)
    x, y = np.round(path[-1] / 5) * 5
    n = scenario.hrm.cells
    grid = Grid((x - n / 4, y - n / 4), 0.5, (n, n))
    hrm = seen_map(scene, grid, path, 10 + index)
    rows = registers_of(seen_map(scene, scenario.grid.grid, path, index), LENGTH_S * 1000)
    prior = unpack(prior_records(scenario), scenario.grid.grid)
    start = Grid((float(path[0, 0]) - n / 4, float(path[0, 1]) - n / 4), 0.5, (n, n))
    at, cols = scenario.grid.grid.rows_cols(np.stack(np.meshgrid(*start.centres_m()), axis=-1))
    inside = scenario.grid.grid.contains(at, cols)
    initial = np.where(
        inside, prior.height[np.clip(at, 0, prior.grid.rows - 1), np.clip(cols, 0, prior.grid.cols - 1)], np.nan
    )
    time_ns = np.arange(LENGTH_S) * 10**9
    return {
        **{f"hrm_{name}": getattr(hrm, name) for name in BASIC_LAYERS},
        "hrm_origin_m": np.array(grid.origin_m), "hrm_cell_m": np.array(0.5),
        "initial_hrm_height": initial.astype(np.float32), "initial_hrm_origin_m": np.array(start.origin_m),
        "registers": rows, "acknowledged": rows.copy(),
        "backlog": np.stack([time_ns, 20 + 60 * ((time_ns // 10**9) % 20 > 14)], axis=1),
    }  # fmt: skip


def laser_artifacts(scenario: Scenario, scene: Scene, index: int) -> dict[str, Any]:
    """The last scan, cast for real."""
    poses = np.zeros(scenario.robots + len(scenario.vehicles), POSE)
    for i in range(scenario.robots):
        x, y = way(scenario, i)[-1]
        poses[i]["position_m"] = x, y, float(scene.height_m(x, y))
        poses[i]["quaternion_wxyz"], poses[i]["present"] = (1, 0, 0, 0), 1
    ranges = Laser(scenario, keys.robot_id(index + 1), RangeImager(scene, scenario.laser)).scan(poses, 1, 5)
    assert ranges is not None
    return {
        "last_stamp_ns": np.array(LENGTH_S * 10**9), "last_ranges": ranges,
        "last_position_m": poses[index]["position_m"], "last_quaternion_wxyz": poses[index]["quaternion_wxyz"],
    }  # fmt: skip


def world_artifacts(scenario: Scenario, scene: Scene) -> dict[str, Any]:
    """True paths and radio of all robots."""
    out: dict[str, Any] = {}
    for i in range(scenario.robots):
        path = way(scenario, i)
        stamp = np.arange(len(path)) * scenario.frame_ns
        z = scene.height_m(path[:, 0], path[:, 1])
        out[f"robot_{i + 1:03d}_truth"] = np.column_stack([stamp, path, z, np.zeros((len(path), 2))]).astype(np.float64)
        out[f"robot_{i + 1:03d}_radio"] = ~((np.abs(path - 70.0) < 20.0).all(axis=1))
    loop = np.stack([110 + 20 * np.cos(np.arange(600) / 80), 60 + 20 * np.sin(np.arange(600) / 80)], axis=1)
    out["vehicle_0_path"] = np.column_stack([np.arange(600) * scenario.frame_ns, loop, np.zeros(600)]).astype(
        np.float64
    )
    return out


def orchestrator_artifacts(scenario: Scenario) -> dict[str, Any]:
    """All waypoints visited but the last; flush two seconds before the end."""
    visited = np.linspace(5, LENGTH_S - 5, len(scenario.patrol)).astype(np.int64) * 10**9
    visited[-1] = -1
    return {
        "phase_names": np.array(["mapping", "flush", "end"]),
        "phase_stamps_ns": np.array([0, LENGTH_S - 2, LENGTH_S]) * 10**9,
        "visited_ns": visited, "visited_by": np.where(visited >= 0, 1, 0),
    }  # fmt: skip


def made_up(scenario: Scenario) -> RunParts:
    """A finished run of `scenario`."""
    scene, grid = build_scene(scenario), scenario.grid.grid
    robots = [keys.robot_id(i + 1) for i in range(scenario.robots)]
    mapping = {keys.node(keys.MAPPING, r): mapping_artifacts(scenario, scene, i) for i, r in enumerate(robots)}
    held = []
    for number, arrays in enumerate(mapping.values(), 1):
        register = np.zeros(len(arrays["registers"]), ROBOT_REGISTER)
        for name in REGISTER.names or ():
            register[name] = arrays["registers"][name]
        register["robot"] = number
        held.append(register)
    prior = whole_prior(prior_records(scenario), grid.size)
    glrm = fold_registers(prior, np.concatenate(held), Rules.of(scenario.rules))
    for arrays in mapping.values():
        arrays["copy"] = glrm.copy()
    first = np.where(glrm["confidence"] >= 64, np.random.default_rng(3).integers(1, LENGTH_S, grid.size) * 10**9, -1)
    nodes: dict[str, Any] = {
        keys.WORLD: world_artifacts(scenario, scene), **mapping, keys.ORCHESTRATOR: orchestrator_artifacts(scenario),
        keys.MANAGER: {"glrm": glrm, "registers": np.concatenate(held), "prior": prior, "first_confident_ns": first,
                       "changed_ms": np.where(np.arange(grid.size) == 3 * grid.cols + 4, 30_500, -1)},
    }  # fmt: skip
    for i, robot in enumerate(robots):
        nodes[keys.node(keys.LASER, robot)] = laser_artifacts(scenario, scene, i)
        truth = nodes[keys.WORLD][f"{robot}_truth"]
        nodes[keys.node(keys.NAVIGATOR, robot)] = {"trajectory": truth + np.array([0, 0.03, 0.04, 0, 0, 0])}
    rng = np.random.default_rng(4)
    stages = {name: {s: rng.integers(20_000, 90_000, 200) for s in STAGES if s != "fold"} for name in mapping}
    stages[keys.MANAGER] = {"fold": rng.integers(5_000, 20_000, 200)}
    events = [
        {"stamp_ns": 10**9 * k, "service": service, "robot": robot, "event": event}
        for k, service, robot, event in (
            (0, "orchestrator", None, "phase"), (1, "navigator", "robot_001", "waypoint"),
            (20, "navigator", "robot_002", "stuck"), (23, "navigator", "robot_002", "recovered"),
            (58, "orchestrator", None, "phase"),
        )
    ]  # fmt: skip
    changed = {"cell": 3 * grid.cols + 4, "since_ms": 30_500, "from_top_m": None, "to_top_m": 9.75}
    events.insert(4, {"stamp_ns": 36 * 10**9, "service": keys.MANAGER, "robot": None, "event": "changed", **changed})
    result = WorldResult(sim_time_s=LENGTH_S, wall_time_s=7.5, complete=True, copies_equal=True, deterministic=True)
    machine = Machine(
        processor="Made-up <CPU> 2.0 GHz", cores=2, memory_bytes=8 * 1024**3, system="Linux 6.1, x86_64",
        python="3.11.2", packages={"numpy": "2.0.0"},
    )  # fmt: skip
    run = RunInfo.ran(result, scenario, "in-process", "0123456789ab", machine)
    return RunParts(
        scenario=scenario, run=run, nodes=nodes, stages_ns=stages, bytes_up=dict.fromkeys(robots, 90_000),
        bytes_down=dict.fromkeys(robots, 200_000), events=tuple(events),
    )  # fmt: skip


def made_up_summary(robots: int) -> Summary:
    """What a study reads of a run: a map that is 0.2 m from ideal scans."""
    none = height_error(np.zeros(0))
    score = MapScore(
        cells=9, rmse_m=0.2, mae_m=0.1, bias_m=0.0, p95_m=0.4, occupation_iou=1.0, open_ground=none, buildings=none,
        by_confidence=(),
    )  # fmt: skip
    both = Scores(surface=score, ideal=score)
    figures = MapFigures.model_validate(map_figures(np.zeros(0, JUDGED)))
    pair = PriorAndFinal(prior=figures, final=figures)
    better = Improvement(confident=pair, touched=pair)
    return Summary(
        scenario="city", seed=1, robots=robots, robots_gone=(), robots_revoked=(), mode="lockstep",
        runner="in-process", commit="0123",
        complete=True, waypoints=4, waypoints_missed=(), contacts=(), surface_changes=(), deterministic=True,
        sim_time_s=460.0, wall_time_s=46.0, rtf=10.0, glrm_hash="ab",
        copies_hash_equal=True, glrm_is_own_fold=True, coverage=0.97, observable_cells=9, mapping_time_s={95: 300.0},
        stages_ms={}, bytes_up_per_robot_s=1500.0, bytes_down_per_robot_s=3000.0, cells_acked=9, cells_lost=0,
        missing_parts=(), score=MapScores(glrm=both, hrm=both), improvement=Improvements(glrm=better, hrm=better),
    )  # fmt: skip


def leave(parts: RunParts, out: Path) -> None:
    """Write a run's parts as the services do."""
    run_folder.write_whole(out / run_folder.SCENARIO, parts.scenario.model_dump_json())
    parts.run.write(out)
    for name, arrays in parts.nodes.items():
        run_folder.write_arrays(out / run_folder.node_file(name), arrays)
    for name, stages in parts.stages_ns.items():
        content = {stage: [int(v) for v in values] for stage, values in stages.items()}
        run_folder.write_whole(out / run_folder.stages_file(name), json.dumps(content))
    for i, robot in enumerate(parts.robots):
        with Recording(out, f"p{i}") as recording:
            recording.save_bytes({robot: parts.bytes_up[robot]}, {robot: parts.bytes_down[robot]})
    for i in (0, 1):
        lines = [json.dumps(e) for e in parts.events[i::2]]
        run_folder.write_whole(out / run_folder.events_file(f"p{i}"), "\n".join(lines) + "\n")
