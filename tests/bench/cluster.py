"""What the cluster costs, beside local processes in the same run, as a table and a last JSON line.

Run by `make cluster-bench`. Hops and scans are seen by the chaos suite's witness, which costs a little itself.
"""

from __future__ import annotations

import json
import os
import sys
import tempfile
import time
from collections import defaultdict
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import goals
import numpy as np
from chaos.cluster import Cluster, call, until
from chaos.runner import await_end
from chaos.watch import Line, Watch
from orograph import keys
from orograph.launch.lifecycle import resolve, run
from orograph.launch.machine import commit
from orograph.storage.results import Summary, WorldResult
from orograph.storage.scenario_file import load_scenario
from pydantic import ByteSize, TypeAdapter
from rich.console import Console
from rich.table import Table

GOALS = {
    "healthy_s": ("<=", 30.0, "`up --wait`, 3 robots, image built"),
    "rtf_containers_to_local": (
        ">=",
        0.8,
        "`paper`, 3 robots, lockstep: real-time factor in containers / as processes",
    ),
    "hop_p95_s": ("<=", 3.0, "`paper`, 3 robots, paced at 1: a scan's stamp to another robot's copy"),
    "rtf_10_robots_paced": (">=", 0.99, "`tiny`, 10 robots, paced at 1"),
    "claimed_s": ("<=", 30.0, "32 lasers started at once: 10 hold a robot, 22 know that they are spares"),
}
PAPER = {"ROBOTS": "3", "SCENARIO": "paper"}
HOP_FRAMES = 900
TEN = {"ROBOTS": "10", "SCENARIO": "tiny", "TIME_SCALE": "1"}
WORKERS = 32


def local_rtf() -> float:
    """`paper` with three robots, each service a process of its own."""
    with tempfile.TemporaryDirectory() as folder:
        out = run(resolve(load_scenario("paper"), 3, None, None), Path(folder) / "run", capacity=1)
        return Summary.read(out).rtf or 0.0


def contained() -> dict[str, float]:
    """The same mission in containers."""
    with Cluster(PAPER, {}) as it:
        begin_s = time.monotonic()
        it.compose("up", "--detach", "--wait", "--wait-timeout", "120", "--scale", "witness=0")
        healthy_s = time.monotonic() - begin_s
        call("docker", "wait", it.only(keys.WORLD))  # no polling: each question would cost a process
        return {"healthy_s": healthy_s, "rtf_containers": whole_rtf(it)}


def whole_rtf(it: Cluster) -> float:
    """Real-time factor of a mission that has ended."""
    with tempfile.TemporaryDirectory() as folder:
        world = WorldResult.read(it.fetch(Path(folder)))
        return world.sim_time_s / world.wall_time_s


def memory_mb(it: Cluster) -> dict[str, float]:
    """Memory of the largest container of each service, page cache left out [MB], as `docker stats` has it."""
    told = call("docker", "stats", "--no-stream", "--format", "{{.Name}} {{.MemUsage}}")
    found: defaultdict[str, float] = defaultdict(float)
    for name, used in (line.split()[:2] for line in told.splitlines() if line.startswith(it.project)):
        service = name.removeprefix(f"{it.project}-").rsplit("-", 1)[0]
        found[service] = max(found[service], TypeAdapter(ByteSize).validate_python(used) / 1e6)
    return dict(sorted(found.items()))


def hops_s(lines: Sequence[Line], frame_s: float) -> list[float]:
    """Simulation time from the newest scan in each record to the frame in which another robot's copy can hold it.

    The deltas of the first beat after the record's acknowledgement are looked at; a record that changed no value of the
    map is in none of them and does not count.
    """
    sent: dict[tuple[str, int, int], float] = {}
    waiting: dict[int, float] = {}
    out = []
    for line in lines:
        if line["kind"] == "Batch":
            rows = zip(line["cell"], line["seq"], line["tick"], strict=True)
            sent.update({(line["robot"], cell, seq): tick / 1000 for cell, seq, tick in rows})
        elif line["kind"] == "Ack":
            acked = [(line["robot"], cell, seq) for cell, seq in zip(line["cell"], line["seq"], strict=True)]
            waiting.update({key[1]: sent.pop(key) for key in acked if key in sent})
        elif line["kind"] == "Delta" and not line["repair"]:
            out += [(line["frame"] + 1) * frame_s - waiting.pop(cell) for cell in line["cell"] if cell in waiting]
            if line["part"] + 1 == line["parts"]:
                waiting.clear()
    return out


def paced() -> tuple[list[float], dict[str, float]]:
    """(hops [s], memory by service [MB]) of the first minute and a half of `paper` at real time."""
    with Cluster({**PAPER, "TIME_SCALE": "1"}, {}) as it:
        it.compose("up", "--detach")
        with Watch(it) as watch:
            watch.await_frame(HOP_FRAMES, 240.0)
            return hops_s(list(watch.lines), load_scenario("paper").frame_ns * 1e-9), memory_mb(it)


def ten_robots() -> dict[str, float]:
    """Real-time factor, and the share of the scans that was mapped, with ten robots at the pace of real time."""
    with Cluster(TEN, {}) as it:
        it.compose("up", "--detach")
        with Watch(it) as watch:
            await_end(it)
            figures = dict(watch.figures)
        made = sum(f.get("scans", 0) for name, f in figures.items() if name.startswith(keys.LASER))
        mapped = sum(f.get("scans", 0) for name, f in figures.items() if name.startswith(keys.MAPPING))
        return {"rtf_10_robots_paced": whole_rtf(it), "scans_mapped_10_robots": mapped / made}


def claims_s() -> float:
    """From the start of 32 laser containers until each holds a robot or knows that it is a spare."""
    with Cluster({"ROBOTS": "10", "SCENARIO": "tiny"}, {}) as it:
        it.compose("up", "--detach", "--wait", keys.ORCHESTRATOR)
        begin_s = time.monotonic()
        it.compose("up", "--detach", "--no-recreate", "--scale", f"{keys.LASER}={WORKERS}", keys.LASER)

        def all_said() -> bool:
            logs = [it.logs(container) for container in it.containers(keys.LASER)]
            return sum("ready: " in log or "wait as a spare" in log for log in logs) == WORKERS

        until(all_said, "all claims", 240, poll_s=2.0)
        return time.monotonic() - begin_s


def measure() -> tuple[dict[str, Any], dict[str, float]]:
    """(figures, memory by service [MB])."""
    figures: dict[str, Any] = {"rtf_local": local_rtf(), **contained()}
    figures["rtf_containers_to_local"] = figures["rtf_containers"] / figures["rtf_local"]
    hops, memory = paced()
    figures |= {"hop_p50_s": float(np.percentile(hops, 50)), "hop_p95_s": float(np.percentile(hops, 95))}
    figures |= {"hops": len(hops), **ten_robots(), "claimed_s": claims_s()}
    return figures, memory


def main() -> int:
    """Print both tables, then the JSON line."""
    figures, memory = measure()
    used = Table("service", "memory [MB]")
    for service, mb in memory.items():
        used.add_row(service, f"{mb:,.0f}")
    console = Console(width=140)
    console.print(goals.table(GOALS, figures))
    console.print(used)
    rounded = {k: float(f"{v:.4g}") for k, v in figures.items()}
    print(json.dumps({**rounded, "memory_mb": memory, "cores": os.cpu_count(), "commit": commit()}))
    return 0


if __name__ == "__main__":
    sys.exit(main())
