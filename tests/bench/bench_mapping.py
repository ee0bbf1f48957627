"""One scan of 30 000 points from points to list, by stage, and pyoctomap's `insertPointCloud` on the same points.

A street canyon is scanned by a 42 x 760 laser at a walking robot's stations; the first 30 000 hits of each scan count.
All times are the thread's processor time, which a busy machine stretches less, and both sides alike.
"""

from __future__ import annotations

import time
from collections.abc import Callable

import numpy as np
import numpy.typing as npt
import pyoctomap
from orograph.geometry import ray_directions, rotation
from orograph.grid import Grid
from orograph.mapping import RobotMapper
from orograph.messages import RANGE_UNIT_M, UPDATE
from orograph.points import points_from_ranges
from orograph.rules import PAPER, SURFACE, Rules
from orograph.scenario import LaserSpec
from orograph.stages import STAGES, StageRecorder

POINTS = 30_000
OCTOMAP_CELL_M = 0.5
LASER = LaserSpec(rings=56, columns=760)
GLRM = Grid((0.0, 0.0), 5.0, (200, 200))
FRAMES = 60
WHOLE = "points to list, whole"
FRAME_NS = 400_000_000
F64 = npt.NDArray[np.float64]


def houses() -> F64:
    """Boxes (n, 2, 3): lowest and highest corner [m] of blocks 40 m x 24 m on a 60 m x 40 m raster, 6 to 14 m high."""
    heights_m = np.random.default_rng(7).uniform(6.0, 14.0, (10, 14))
    x, y = np.meshgrid(np.arange(10) * 60.0 + 208.0, np.arange(14) * 40.0 + 208.0, indexing="ij")
    low = np.stack([x, y, np.zeros_like(x)], axis=-1).reshape(-1, 3)
    return np.stack([low, low + np.stack([x * 0 + 40.0, x * 0 + 24.0, heights_m], axis=-1).reshape(-1, 3)], axis=1)


def ranges_m(eye_m: F64, directions: F64, boxes: F64) -> F64:
    """Distance (n,) to flat ground or the nearest box along unit directions (n, 3); infinity where nothing is hit."""
    with np.errstate(divide="ignore", invalid="ignore"):
        nearest = np.where(directions[:, 2] < 0, -eye_m[2] / directions[:, 2], np.inf)
        for low, high in boxes:
            a, b = (low - eye_m) / directions, (high - eye_m) / directions
            enter, leave = np.fmin(a, b).max(axis=1), np.fmax(a, b).min(axis=1)
            nearest = np.where((enter <= leave) & (enter > 0) & (enter < nearest), enter, nearest)
    return nearest


def scans() -> list[tuple[npt.NDArray[np.uint16], F64, F64]]:
    """Range images (n,) of POINTS hits, R_map_robot and laser position of a robot that walks a street at 1.5 m/s."""
    boxes, drawn, out = houses(), np.random.default_rng(3), []
    directions = ray_directions(LASER).reshape(-1, 3).astype(np.float64)
    for frame in range(FRAMES):
        R, eye_m = rotation(0.01, -0.01, 0.02 * frame), np.array([420.0 + 0.6 * frame, 440.0, 0.87])
        distance = ranges_m(eye_m, directions @ R.T, boxes) + drawn.normal(0, 0.02, len(directions))
        hit = np.flatnonzero((distance > 0.4) & (distance < LASER.range_max_m))
        image = np.zeros(len(directions), np.uint16)
        kept = np.sort(drawn.permutation(hit)[:POINTS])
        assert len(kept) == POINTS, len(kept)
        image[kept] = np.round(distance[kept] / RANGE_UNIT_M)
        out.append((image, R, eye_m))
    return out


def figures() -> dict[str, float]:
    """`scan_ms` (median, points to list), the same by the rules of the paper, `octomap_ratio`; prints them by stage."""
    images = scans()
    for rules in (PAPER, SURFACE):
        map_all(images, rules)
    timed, of_paper = map_all(images, SURFACE), map_all(images, PAPER)
    octomap_ms = insert_all(images[:3])
    scan_ms = float(np.median(timed[WHOLE]))
    ratio = float(np.median(octomap_ms)) / scan_ms
    print(f"one scan of {POINTS} points, {FRAMES} scans, one core; pyoctomap's insertPointCloud at {OCTOMAP_CELL_M} m")
    others = {"the same by the paper's rules": of_paper[WHOLE], "pyoctomap, the same points": octomap_ms}
    for name, durations_ms in [*timed.items(), *others.items()]:
        low, median, high = np.percentile(durations_ms, [0, 50, 95])
        print(f"  {name:<48} least {low:8.3f}   p50 {median:8.3f}   p95 {high:8.3f} ms")
    print(f"  {ratio:.0f} times pyoctomap's speed")
    return {"scan_ms": scan_ms, "scan_paper_ms": float(np.median(of_paper[WHOLE])), "octomap_ratio": ratio}


def map_all(images: list[tuple[npt.NDArray[np.uint16], F64, F64]], rules: Rules) -> dict[str, list[float]]:
    """Durations [ms] by stage of mapping these scans, with everything acknowledged at once."""
    recorder, directions = StageRecorder(time.thread_time_ns), ray_directions(LASER)
    mapper = RobotMapper(GLRM, 320, 10, rules, LASER.range_max_m, stage=recorder)
    prior = np.tile(np.array([0, 0, 0, 0, 32], np.float32), (GLRM.size, 1))
    told, held = np.zeros(GLRM.size, np.uint8), np.zeros(GLRM.size, UPDATE)
    whole_ms: list[float] = []
    planning_ms: list[float] = []
    for frame, (image, R, eye_m) in enumerate(images):
        with recorder("points"):
            points, distances_m = points_from_ranges(image, directions, R, eye_m)
        begin = time.thread_time()
        records = mapper.step(points, distances_m, eye_m, frame * FRAME_NS, held)
        whole_ms.append((time.thread_time() - begin) * 1e3)
        held[records["cell"]] = records
        planning_ms.append(_duration_ms(lambda: mapper.planning_occupation(prior, told)))
    stages = {f"{name} ({STAGES[name]})": [d / 1e6 for d in ns] for name, ns in recorder.durations_ns.items()}
    return {**stages, WHOLE: whole_ms, "planning map": planning_ms}


def insert_all(images: list[tuple[npt.NDArray[np.uint16], F64, F64]]) -> list[float]:
    """Durations [ms] of inserting each cloud into one octree."""
    tree, directions = pyoctomap.OcTree(OCTOMAP_CELL_M), ray_directions(LASER)
    durations_ms = []
    for image, R, eye_m in images:
        points = np.ascontiguousarray(points_from_ranges(image, directions, R, eye_m)[0])
        begin = time.thread_time()
        tree.insertPointCloud(points, eye_m, LASER.range_max_m)
        durations_ms.append((time.thread_time() - begin) * 1e3)
    return durations_ms


def _duration_ms(call: Callable[[], object]) -> float:
    begin = time.thread_time()
    call()
    return (time.thread_time() - begin) * 1e3


if __name__ == "__main__":
    figures()
