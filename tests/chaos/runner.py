"""Chaos in real containers: workload, nemesis, checkers, a verdict from what was recorded. `make chaos ONLY=F1,F8`."""

from __future__ import annotations

import argparse
import io
import json
import signal
import subprocess
import sys
import tarfile
import time
from collections.abc import Iterable, Iterator
from dataclasses import asdict
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from chaos.checkers import fallen, violations
from chaos.cluster import ROOT, ChaosError, Cluster, until
from chaos.evidence import Evidence, latencies_s, read, settled_s
from chaos.experiments import EXPERIMENTS, SMALL_DISK, Experiment, chosen
from chaos.nemeses import Mission
from chaos.watch import Watch
from orograph import keys
from orograph.judge.checks import lost_cells
from orograph.launch.machine import commit
from orograph.protocol.tiles import map_hash

SEED = 1
END_WITHIN_S = 240.0
GOAL_S = 10.0
SHOWN = 5
Verdict = dict[str, Any]


def carry_out(experiment: Experiment, keep: Path | None = None) -> Verdict:
    """Run one experiment and judge it; the cluster is gone afterwards whatever happened."""
    seed, begin_s = int(experiment.wishes.get("SEED", SEED)), time.monotonic()
    wishes = {"ROBOTS": "2", "SCENARIO": "tiny", **experiment.wishes}
    verdict: Verdict = {"experiment": experiment.name, "what": experiment.what, "seed": seed, "commit": commit()}
    try:
        with Cluster(wishes, experiment.overlay) as cluster:
            evidence = _mission(experiment, cluster, seed, keep, verdict)
    except ChaosError as error:
        return {**verdict, "ok": False, "violations": [f"not carried out: {error}"], "figures": {}}
    found = list(violations(evidence))
    figures = {**measure(evidence), "total_s": round(time.monotonic() - begin_s, 1)}
    mutant = experiment.caught_by
    ok = any(v.split(":")[0] in mutant for v in found) if mutant else not found
    return {**verdict, "ok": ok, "caught_by": mutant, "violations": found, "figures": figures}


def _mission(experiment: Experiment, cluster: Cluster, seed: int, keep: Path | None, verdict: Verdict) -> Evidence:
    cluster.compose("up", "--detach", *_first_scale(experiment))
    with Watch(cluster) as watch, TemporaryDirectory() as scratch:
        mission = Mission(cluster, watch, seed)
        try:
            experiment.nemesis(mission)
            await_end(cluster)
        finally:
            verdict["timeline"] = [asdict(action) for action in mission.actions]
            if keep is not None:
                _keep(cluster, watch, keep / experiment.name)
        folder = cluster.fetch(Path(scratch))
        if experiment.overlay is SMALL_DISK:
            _fetch_disk(cluster, folder)
        lines = list(watch.lines)
        evidence = read(folder, lines, mission.actions)
    evidence.restarted, evidence.conflicts = mission.restarted, mission.conflicts
    evidence.healthy, evidence.left = experiment.healthy, frozenset(mission.left)
    return evidence


def _first_scale(experiment: Experiment) -> list[str]:
    first = experiment.wishes.get("START_WITH")
    return [word for s in keys.ROBOT_SERVICES for word in ("--scale", f"{s}={first}")] if first else []


def await_end(cluster: Cluster) -> None:
    """The world has ended the run and everybody has left its part; the report is not waited for."""

    def ended() -> bool:
        services = (keys.WORLD, keys.MANAGER, *keys.ROBOT_SERVICES)
        return all(state == "exited" for service, state in cluster.states() if service in services)

    until(ended, "the mission's end", END_WITHIN_S)


def _keep(cluster: Cluster, watch: Watch, out: Path) -> None:
    """For people: every container's log and the witness's lines."""
    out.mkdir(parents=True, exist_ok=True)
    (out / "logs.txt").write_text(cluster.compose("logs", "--no-color", "--timestamps", "--no-log-prefix=false",
                                                  "world", keys.MANAGER, keys.ORCHESTRATOR, "router-sim",
                                                  "router-radio", *keys.ROBOT_SERVICES, check=False))  # fmt: skip
    (out / "witness.jsonl").write_text("".join(json.dumps(line) + "\n" for line in list(watch.lines)))


def _fetch_disk(cluster: Cluster, folder: Path) -> None:
    """The manager's small disk, seen through the witness that held it, put where the run's other parts are."""
    line = ["docker", "exec", cluster.only("witness"), "tar", "-C", f"/disk/{folder.name}", "-c", "."]
    packed = subprocess.run(line, capture_output=True, check=True).stdout
    with tarfile.open(fileobj=io.BytesIO(packed)) as tar:
        tar.extractall(folder, filter="data")


def measure(evidence: Evidence) -> dict[str, Any]:
    """The figures of a verdict."""
    run, ledger = evidence.parts.run, evidence.ledger
    heal, actions = evidence.heal, evidence.actions
    last = {line["node"]: line["figures"] for line in evidence.of("figures")}
    mapping = [last.get(keys.node(keys.MAPPING, robot), {}) for robot in evidence.parts.robots]
    settled = settled_s(evidence)
    begin = min((a.at for a in actions), default=0.0)
    waits = latencies_s(evidence, evidence.healthy, lambda t: heal is not None and begin <= t <= heal.at)
    return {
        "sim_time_s": round(run.sim_time_s, 1), "wall_time_s": round(run.wall_time_s, 1),
        "complete": run.complete, "deterministic": run.deterministic,
        "glrm_hash": "" if ledger.glrm is None else map_hash(ledger.glrm).hex(),
        "settled_s": None if settled is None else round(settled, 1),
        "cells_acked": sum(len(a) for a in ledger.acked.values()),
        "cells_lost": sum(lost_cells(ledger, robot) for robot in ledger.acked),
        "acks_seen": len(evidence.of("Ack")),
        "manager_lives": len({line["manager_epoch"] for line in evidence.of("Digest")}),
        "batches_unanswered": sum(f.get("batches_unanswered", 0) for f in mapping),
        "copy_repairs": sum(f.get("copy_repairs", 0) for f in mapping),
        "confidence_fell_cells": len(list(fallen(evidence))),
        "healthy_p99_s": round(float(np.percentile(waits, 99)), 2) if waits else None,
    }  # fmt: skip


def table(verdicts: Iterable[Verdict]) -> str:
    """A line each, for people."""
    head = (
        f"{'':4} {'what':46} {'verdict':9} {'settled':>8} {'acked':>6} {'lost':>5} {'lives':>5}"
        f" {'p99 of others':>13} {'sim':>6} {'wall':>6}"
    )
    lines = [head]
    for v in verdicts:
        f = v["figures"]
        word = ("RED" if v["violations"] else "green") + ("" if v["ok"] else " (!)")
        cells = [_cell(f, "settled_s", 8, " s"), _cell(f, "cells_acked", 6), _cell(f, "cells_lost", 5),
                 _cell(f, "manager_lives", 5), _cell(f, "healthy_p99_s", 13, " s"), _cell(f, "sim_time_s", 6),
                 _cell(f, "wall_time_s", 6)]  # fmt: skip
        lines.append(f"{v['experiment']:4} {v['what']:46} {word:9} {' '.join(cells)}")
        lines += [f"       {found[:180]}" for found in v["violations"][:SHOWN]]
        if len(v["violations"]) > SHOWN:
            lines.append(f"       ... {len(v['violations']) - SHOWN} more")
    return "\n".join(lines)


def _cell(figures: dict[str, Any], name: str, width: int, unit: str = "") -> str:
    value = figures.get(name)
    return f"{'-' if value is None else f'{value}{unit}':>{width}}"


def summary(verdicts: list[Verdict]) -> Verdict:
    """The last line: what it all came to."""
    settled = sorted(v["figures"]["settled_s"] for v in verdicts if v["figures"].get("settled_s") is not None)
    p95 = round(float(np.percentile(settled, 95)), 1) if settled else None
    return {
        "commit": commit(), "experiments": len(verdicts), "failed": [v["experiment"] for v in verdicts if not v["ok"]],
        "settled_p95_s": p95, "settled_goal_s": GOAL_S,
    }  # fmt: skip


def _carry_out_all(experiments: Iterable[Experiment], out: Path, deadline_s: float) -> Iterator[Verdict]:
    """One after the other, each verdict written as soon as it is there."""
    out.mkdir(parents=True, exist_ok=True)
    for experiment in experiments:
        print(f"{experiment.name}: {experiment.what} ...", file=sys.stderr, flush=True)
        if time.monotonic() < deadline_s:
            verdict = carry_out(experiment, out)
        else:
            verdict = {"experiment": experiment.name, "what": experiment.what, "ok": False, "figures": {},
                       "violations": ["not carried out: the suite's time was up"]}  # fmt: skip
        (out / f"{experiment.name}.json").write_text(json.dumps(verdict, indent=2) + "\n")
        print(table([verdict]).split("\n", 1)[1], file=sys.stderr, flush=True)
        yield verdict


def main() -> int:
    """Carry out the chosen experiments; 0 when each verdict is as it must be."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--only", default="", help="names, comma-separated: " + ", ".join(e.name for e in EXPERIMENTS))
    parser.add_argument("--out", type=Path, default=ROOT / "runs" / "chaos", help="folder of the verdicts")
    parser.add_argument("--minutes", type=float, default=60.0, help="what has not begun by then counts as failed")
    arguments = parser.parse_args()
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    try:
        experiments = chosen(arguments.only)
    except ValueError as error:
        print(f"chaos: {error}", file=sys.stderr)
        return 2
    verdicts = list(_carry_out_all(experiments, arguments.out, time.monotonic() + 60 * arguments.minutes))
    print(table(verdicts))
    print(json.dumps(summary(verdicts)))
    return 0 if all(v["ok"] for v in verdicts) else 1


if __name__ == "__main__":
    sys.exit(main())
