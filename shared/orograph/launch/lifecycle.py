"""The life of a run, from a resolved scenario to a finished run folder."""

from __future__ import annotations

import time
from pathlib import Path
from typing import Literal

from pydantic import ValidationError

from orograph.errors import InputError, RunError
from orograph.launch.machine import commit, this_machine
from orograph.launch.progress import OnProgress, unseen
from orograph.scenario import Scenario
from orograph.storage.results import RunInfo, Start, WorldResult
from orograph.storage.run_folder import LOGS, SCENARIO, WORLD, new_folder, write_whole


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
    ports: tuple[int, int] = (0, 0), on_progress: OnProgress = unseen, page_port: int | None = None,
    record: bool = False,
) -> Path:  # fmt: skip
    """Run a resolved scenario to a finished run folder and return it; raises InputError, RunError."""
    out = prepare_out(out, scenario)
    if in_process:
        from orograph.launch.in_process import run_in_process

        run_in_process(scenario, out, on_progress)
    else:
        from orograph.launch.processes import run_processes

        run_processes(scenario, out, capacity, ports, on_progress, page_port, record)
    finish(scenario, out, "in-process" if in_process else "processes")
    return out


def prepare_out(out: Path | None, scenario: Scenario) -> Path:
    """A new or empty run folder that says what is to run, and since when; raises InputError where it can't be had."""
    out = new_folder(out, scenario.name)
    try:
        write_whole(out / SCENARIO, scenario.model_dump_json())
        Start(unix_s=time.time()).write(out)
    except OSError as error:
        raise InputError(f"--out {out}: cannot be written ({error.strerror})") from None
    return out


def finish(scenario: Scenario, out: Path, runner: str) -> None:
    """Compose the finished run folder from what the services left; raises RunError where they left nothing."""
    from orograph.report.folder import compose  # heavy: only once there is something to compose

    if not (out / WORLD).exists():
        raise RunError(f"the world left no result; logs are in {out / LOGS}")
    start_s = Start.read(out).unix_s
    RunInfo.ran(WorldResult.read(out), scenario, runner, commit(), this_machine(), start_s).write(out)
    compose(out)
