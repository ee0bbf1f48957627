"""The hot paths in one table and a last JSON line; absolute times drift on shared machines, ratios do not.

Run by `make bench`. Each `bench_*.py` beside this file gives `figures()`; the mission figures come from a run of
`paper` with three robots over Zenoh, by the same call sites as any other run.
"""

from __future__ import annotations

import json
import os
import platform
import sys
import tempfile
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent))

import bench_fold
import bench_mapping
import bench_physics
import bench_rays
import bench_recordings
import goals
from orograph import keys
from orograph.launch.lifecycle import resolve, run
from orograph.launch.machine import commit
from orograph.storage.results import Summary
from orograph.storage.run_folder import process_file
from orograph.storage.scenario_file import load_scenario
from rich.console import Console

GOALS = {
    "scan_ms": ("<=", 1.0, "30 000 points -> aux -> HRM -> LLRM -> list, median, one core"),
    "octomap_ratio": (">=", 100.0, "times faster than pyoctomap's insertPointCloud on the same points"),
    "map_scans_per_s": (">=", 50.0, "`orograph map`: scans of 120 000 points read, placed and mapped, one core"),
    "rays_ratio": (">=", 2.5, "rays with bodies, noise and steps, times as many as embreex casts without, one core"),
    "physics_ms": ("<=", 1.0, "5 ms step with 30 robots"),
    "fold_us": ("<=", 1.0, "fold of one cell with 3 contributors"),
    "rtf_paper_3": (">=", 8.0, "`paper`, 3 robots, lockstep over Zenoh: simulated s per s"),
    "rss_mapping_mb": ("<=", 250.0, "peak memory of a robot-mapping process with one robot"),
    "bytes_up_per_robot_s": ("<=", 10_000.0, "radio bytes up per robot and simulated second on `paper`"),
}


def mission_figures(capacity: int) -> dict[str, float]:
    """Real-time factor, bytes up and memory of one `paper` mission over Zenoh."""
    scenario = resolve(load_scenario("scenarios/paper"), 3, None, None)
    with tempfile.TemporaryDirectory() as folder:
        out = run(scenario, Path(folder) / "run", capacity=capacity)
        summary = Summary.read(out)
        processes = [json.loads(p.read_text()) for p in out.glob(process_file(f"{keys.MAPPING}-*"))]
    return {
        "rtf_paper_3": summary.rtf or 0.0,
        "bytes_up_per_robot_s": summary.bytes_up_per_robot_s or 0.0,
        "rss_mapping_mb": max(p["rss_max_bytes"] for p in processes) / 1e6,
    }


def main() -> int:
    """Print the table, then the JSON line."""
    figures: dict[str, float] = {}
    for bench in (bench_mapping, bench_recordings, bench_rays, bench_physics, bench_fold):
        figures.update(bench.figures())
    shared, single = mission_figures(capacity=3), mission_figures(capacity=1)
    figures.update(shared)
    figures["rtf_paper_3_one_process_each"] = single["rtf_paper_3"]
    figures["rss_mapping_mb"] = single["rss_mapping_mb"]
    Console(width=140).print(goals.table(GOALS, figures))
    machine = {"cores": os.cpu_count(), "machine": platform.machine(), "python": platform.python_version()}
    print(json.dumps({**{k: float(f"{v:.6g}") for k, v in figures.items()}, **machine, "commit": commit()}))
    return 0


if __name__ == "__main__":
    sys.exit(main())
