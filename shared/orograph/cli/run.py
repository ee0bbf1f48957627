"""`orograph run`: one mission from a scenario to a finished run folder."""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import time
from contextlib import nullcontext
from pathlib import Path
from typing import Literal

from pydantic import ValidationError

from orograph.cli.errors import InputError, RunError
from orograph.cli.progress import Progress
from orograph.edge.scenario_file import load_scenario
from orograph.scenario import Scenario


def add_parser(subparsers: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Declare the command's options."""
    parser = subparsers.add_parser(
        "run",
        help="run a mission and write its report",
        description="Run a mission; write its run folder.",
    )
    parser.add_argument("scenario", help="a folder, a scenario.yaml, or a name in ./scenarios")
    parser.add_argument("--robots", type=int, metavar="N", help="how many robots drive (default: the scenario's)")
    parser.add_argument("--seed", type=int, metavar="S", help="seed of all randomness (default: the scenario's)")
    parser.add_argument(
        "--time-scale", metavar="max|X", help="max: lockstep, as fast as it goes; X: paced at X times real time"
    )
    parser.add_argument("--out", type=Path, metavar="DIR", help="run folder, new or empty (default: runs/<name>-NNN)")
    parser.add_argument("--capacity", type=int, default=0, metavar="N",
                        help="robots per service process (default: 1, or all on up to two cores)")  # fmt: skip
    parser.add_argument("--in-process", action="store_true", help="all in one process over a simulated network")
    parser.add_argument("--sim-port", type=int, default=0, metavar="PORT", help="sim plane's port (default: free)")
    parser.add_argument("--radio-port", type=int, default=0, metavar="PORT", help="radio plane's port (default: free)")
    parser.add_argument("--quiet", action="store_true", help="no progress view")
    parser.set_defaults(main=main)


def main(args: argparse.Namespace) -> int:
    """Run and say where the report is."""
    scenario = resolve(load_scenario(args.scenario), args.robots, args.seed, args.time_scale)
    ports = (args.sim_port, args.radio_port)
    out = run(scenario, args.out, in_process=args.in_process, capacity=args.capacity, ports=ports, quiet=args.quiet)
    summary = json.loads((out / "summary.json").read_text())
    copies = "all copies equal" if summary["copies_hash_equal"] else "COPIES DIFFER"
    print(f"map {summary['glrm_hash']} · {copies} · {summary['sim_time_s']:.0f} s of simulation "
          f"in {summary['wall_time_s']:.1f} s\nreport: {out / 'report.html'}")  # fmt: skip
    return 0


def resolve(scenario: Scenario, robots: int | None, seed: int | None, time_scale: str | None) -> Scenario:
    """The scenario with the command line's wishes in it; raises InputError for what it can't be."""
    changes: dict[str, object] = {}
    if robots is not None:
        if not 1 <= robots <= scenario.max_robots:
            raise InputError(f"--robots {robots}: {scenario.name} has starts for 1 to {scenario.max_robots} robots")
        changes["robots"] = robots
    if seed is not None:
        changes["seed"] = seed
    if time_scale is not None:
        changes["time_scale"] = _scale(time_scale)
    try:
        return Scenario.model_validate({**scenario.model_dump(), **changes})
    except ValidationError as error:
        raise InputError("; ".join(f"--{e['loc'][0]}: {e['msg']}" for e in error.errors())) from None


def _scale(text: str) -> Literal["max"] | float:
    if text == "max":
        return "max"
    try:
        return float(text)
    except ValueError:
        raise InputError(f"--time-scale {text}: expected max or a number such as 1.0") from None


def run(
    scenario: Scenario, out: Path | None, *, in_process: bool = False, capacity: int = 0,
    ports: tuple[int, int] = (0, 0), quiet: bool = False,
) -> Path:  # fmt: skip
    """Run a resolved scenario to a finished run folder and return it; raises InputError, RunError."""
    out = prepare_out(out, scenario)
    begin_s = time.time()
    with nullcontext() if quiet else Progress(scenario) as progress:
        on_progress = progress.show if progress is not None else lambda figures, restarts: None
        if in_process:
            from orograph.cli.in_process import run_in_process

            run_in_process(scenario, out, on_progress)
        else:
            from orograph.cli.launch import run_processes

            run_processes(scenario, out, capacity or default_capacity(scenario), ports, on_progress)
    finish(scenario, out, "in-process" if in_process else "processes", begin_s)
    return out


def default_capacity(scenario: Scenario) -> int:
    """One robot per process where there are cores for it; on a small machine processes are shared."""
    return scenario.robots if (os.cpu_count() or 1) <= 2 else 1


def prepare_out(out: Path | None, scenario: Scenario) -> Path:
    """A new or empty run folder that says what is to run; raises InputError where it can't be had."""
    if out is None:
        out = next(p for i in range(1, 10_000) if not (p := Path("runs") / f"{scenario.name}-{i:03d}").exists())
    if out.exists() and (not out.is_dir() or any(out.iterdir())):
        raise InputError(f"--out {out}: not an empty folder; name a new one or remove it")
    try:
        (out / "parts").mkdir(parents=True)
        (out / "parts" / "scenario.json").write_text(scenario.model_dump_json())
    except OSError as error:
        raise InputError(f"--out {out}: cannot be written ({error.strerror})") from None
    return out


def finish(scenario: Scenario, out: Path, runner: str, begin_s: float) -> None:
    """Compose the finished run folder from what the services left; raises RunError where they left nothing."""
    from orograph.report.folder import compose  # heavy: only once there is something to compose

    world_json = out / "parts" / "world.json"
    if not world_json.exists():
        raise RunError(f"the world left no result; logs are in {out / 'logs'}")
    run_json = {
        "seed": scenario.seed, "robots": scenario.robots, "runner": runner, "commit": commit(),
        "mode": "lockstep" if scenario.time_scale == "max" else "paced", "started_unix_s": begin_s,
        **json.loads(world_json.read_text()),
    }  # fmt: skip
    (out / "parts" / "run.json").write_text(json.dumps(run_json))
    compose(out)


def commit() -> str:
    """The checkout's commit, `-dirty` where files differ from it; `unknown` outside a checkout."""
    try:
        described = subprocess.run(
            ["git", "describe", "--always", "--dirty", "--abbrev=12", "--exclude=*"],
            cwd=Path(__file__).parent, capture_output=True, text=True, timeout=10, check=True,
        )  # fmt: skip
    except (OSError, subprocess.SubprocessError):
        return "unknown"
    return described.stdout.strip()
