"""`orograph map` from files to the map: KITTI scans of 120 000 points, uppermost ring first: read, placed, mapped."""

from __future__ import annotations

import tempfile
import time
from pathlib import Path

import numpy as np
from bench_mapping import houses, ranges_m
from orograph.geometry import ray_directions
from orograph.importers.scans.opened import open_recordings
from orograph.launch.recorded import MapRules, map_recordings
from orograph.rules import SURFACE
from orograph.scenario import LaserSpec

LASER = LaserSpec(rings=64, columns=2200, elevation_min_deg=-25, elevation_max_deg=3)
POINTS, MADE, SCANS = 120_000, 6, 60


def write_scans(folder: Path) -> None:
    """SCANS files along a street with poses, MADE of them different."""
    boxes, rays = houses(), ray_directions(LASER)[::-1].reshape(-1, 3).astype(np.float64)
    drawn, made = np.random.default_rng(5), []
    for i in range(MADE):
        distance_m = ranges_m(np.array([420.0 + 1.2 * i, 440.0, 1.7]), rays, boxes) + drawn.normal(0, 0.02, len(rays))
        hit = np.flatnonzero((distance_m > 1) & (distance_m < LASER.range_max_m))[:POINTS]
        made.append(np.column_stack([rays[hit] * distance_m[hit, None], np.zeros(len(hit))]).astype("<f4"))
    for i in range(SCANS):
        made[i % MADE].tofile(folder / f"{i:06d}.bin")
    (folder / "poses.txt").write_text("".join(f"1 0 0 {1.2 * i} 0 1 0 0 0 0 1 0\n" for i in range(SCANS)))


def figures() -> dict[str, float]:
    """Scans a second of one core, the second time round."""
    with tempfile.TemporaryDirectory() as folder:
        write_scans(Path(folder))
        how = MapRules(cell_m=0.5, range_min_m=1.0, range_max_m=80.0, rules=SURFACE)
        for _ in range(2):
            recordings = open_recordings([Path(folder)], None, None, None, None, np.eye(4), ())
            begin_s = time.thread_time()
            mapped = map_recordings(recordings, how, lambda _: None)
            took_s = time.thread_time() - begin_s
    assert mapped.told.points > 0.9 * POINTS * SCANS, mapped.told
    return {"map_scans_per_s": SCANS / took_s}
