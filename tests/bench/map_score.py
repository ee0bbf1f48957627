"""How true are the maps? Recorded missions through any rule set, judged against the scene: `make map-score`.

    map_score.py --rules paper,surface --seeds 3 --scenarios tiny,helsinki,paper --only maps

Prints tables for people and a last JSON line. The missions are recorded once (`map_recording.py`) and kept.
"""

from __future__ import annotations

import argparse
import json
import os
import platform
import sys
from collections import defaultdict
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import partial
from itertools import product
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).parents[1]))

import numpy as np
from bench import map_replay, map_street, map_tables
from bench.map_recording import Mission, recorded
from bench.map_replay import Replay, believed
from orograph.geometry import laser_position_m, ray_directions, rotation_from_quaternion
from orograph.judge.map_obstacles import SIGHTING, Body, ghosts, obstacle_figures, sightings
from orograph.judge.map_score import Judged, calibration, confident, judged, map_figures, wrong_though_sure
from orograph.judge.map_truth import NEAR_GLRM, NEAR_HRM, PLACES_GLRM, PLACES_HRM, MapTruth, true_map, window
from orograph.launch.lifecycle import resolve
from orograph.launch.machine import commit
from orograph.points import points_from_ranges
from orograph.scenario import Scenario
from orograph.scene import Scene, build_scene
from orograph.storage.run_folder import cache_folder
from orograph.storage.scenario_file import load_scenario
from rich.console import Console
from rich.progress import Progress

RULES, SCENARIOS, PRIORS = "paper,surface", "tiny,helsinki,paper", "exact,honest,none"
HONEST = {"ground_error_m": 0.4, "shift_m": 1.0, "missing": 0.1, "extra": 0.1}
OFF_THE_LINES_M = (-1.7, -2.3)
"""How far the honest scenario's grid lies off the scenario's own, for walls on cell borders are a stroke of luck."""


@dataclass
class Pool:
    """What one rule set made of one scenario, all seeds together."""

    cells: defaultdict[str, list[Judged]] = field(default_factory=lambda: defaultdict(list))
    """JUDGED by `glrm` or `hrm`, ` confident`, ` touched` or ` known`, and ` prior` for the prior on the same cells."""
    seen: list[Any] = field(default_factory=list)
    ghosts: list[int] = field(default_factory=list)

    def figures(self) -> dict[str, Any]:
        """Everything, as plain numbers."""
        pooled = {name: np.concatenate(parts) for name, parts in self.cells.items()}
        return {
            **{name: map_figures(cells) for name, cells in pooled.items() if not name.endswith("known")},
            "obstacles": obstacle_figures(np.concatenate([np.zeros(0, SIGHTING), *self.seen]), np.array(self.ghosts)),
            **{f"{level} calibration": calibration(pooled[f"{level} known"]) for level in ("glrm", "hrm")},
            **{f"{level} wrong_though_sure": wrong_though_sure(pooled[f"{level} known"]) for level in ("glrm", "hrm")},
        }


class Judge:
    """The truth of one scenario, and what is measured against it."""

    def __init__(self, scenario: Scenario) -> None:
        self.scene: Scene = build_scene(scenario)
        self._scenario = scenario
        self.glrm: MapTruth = true_map(self.scene, scenario.grid.grid, PLACES_GLRM, NEAR_GLRM)
        fine = scenario.grid.grid.refined(scenario.hrm.per_glrm_cell)
        self.hrm: MapTruth = true_map(self.scene, fine, PLACES_HRM, NEAR_HRM)

    def scans(self, mission: Mission, replay: Replay, pool: Pool, tick: Callable[[], None]) -> None:
        """Map every scan, and look at what planning sees after each."""
        laser, directions = self._scenario.laser, ray_directions(self._scenario.laser)
        open_ground = self.hrm.clear & ~replay.prior_blocked
        for scan, ranges, poses in zip(mission.scans, mission.ranges, mission.bodies, strict=True):
            robot = int(scan["robot"])
            planning = replay.map(robot, ranges, *believed(scan, laser), int(scan["stamp_ns"]))
            own, others = poses[robot - 1], self._bodies(poses, robot)
            R_map_robot = rotation_from_quaternion(own["quaternion_wxyz"])
            eye_m = laser_position_m(laser, R_map_robot, own["position_m"])
            points_m, _ = points_from_ranges(ranges, directions, R_map_robot, eye_m)
            vehicles = others[self._scenario.robots - 1 :]
            pool.seen.append(sightings(planning.blocked, planning.grid, own["position_m"], points_m, vehicles))
            clear = window(open_ground, self.hrm.grid, planning.grid, False)
            pool.ghosts.append(ghosts(planning.blocked, planning.grid, own["position_m"], clear, others))
            tick()

    def maps(self, replay: Replay, pool: Pool) -> None:
        """The maps at the end, and the prior on the same cells."""
        maps = [("glrm", self.glrm, replay.glrm(), replay.prior, replay.glrm_hit())]
        maps += [("hrm", self.hrm.over(hrm.grid), hrm, prior, hit) for hrm, prior, hit in replay.hrms()]
        for level, truth, cells, prior, hit in maps:
            sure = confident(cells, truth)
            where = {"confident": sure, "touched": hit}
            for name, mask in where.items():
                pool.cells[f"{level} {name}"].append(judged(cells, truth, mask))
                pool.cells[f"{level} {name} prior"].append(judged(prior, truth, mask))
            pool.cells[f"{level} known"].append(judged(cells, truth, hit | sure))

    def _bodies(self, poses: Any, own: int) -> list[Body]:
        """Every other body: robots by number, then vehicles; those that are absent are far away."""
        sizes_m = [self._scenario.robot.size_m] * self._scenario.robots + [v.size_m for v in self._scenario.vehicles]
        return [
            Body(p["position_m"] + (0.0 if p["present"] else 1e6), np.array(size), rotation_from_quaternion(
                p["quaternion_wxyz"]))
            for i, (p, size) in enumerate(zip(poses, sizes_m, strict=True)) if i != own - 1
        ]  # fmt: skip


def with_prior(scenario: Scenario, prior: str) -> Scenario:
    """The scenario with `exact` (its own), `honest` or no prior (`none`); scans and truth stay the same."""
    if prior == "exact":
        return scenario
    x_m, y_m = (a + b for a, b in zip(scenario.grid.origin_m, OFF_THE_LINES_M, strict=True))
    grid = {**scenario.grid.model_dump(), "origin_m": (x_m, y_m)}
    changed = {"none": {"prior": {"confidence": 0}}, "honest": {"prior": HONEST, "grid": grid}}[prior]
    return Scenario.model_validate({**scenario.model_dump(), **changed})


def score(
    rule_sets: Sequence[str], priors: Sequence[str], scenarios: Sequence[Scenario], progress: Progress
) -> dict[str, dict[str, dict[str, Any]]]:
    """Figures by scenario with prior and by rule set; each scenario is given with one seed after another."""
    pools: defaultdict[str, defaultdict[str, Pool]] = defaultdict(lambda: defaultdict(Pool))
    judges: dict[str, Judge] = {}
    whole = progress.add_task("missions", total=len(scenarios) * len(priors) * len(rule_sets))
    for scenario in scenarios:
        with _row(progress, f"record {scenario.name} {scenario.seed}", scenario.duration_max_s) as show:
            mission = recorded(scenario, cache_folder(), lambda now_s, show=show: show(completed=now_s))
        for prior, rules in product(priors, rule_sets):
            name, told = f"{scenario.name} {prior}", with_prior(scenario, prior)
            if name not in judges:
                judges[name] = Judge(told)
            replay, pool = Replay(told, rules), pools[name][rules]
            with _row(progress, f"{name} {scenario.seed} {rules}", len(mission.scans)) as show:
                judges[name].scans(mission, replay, pool, lambda show=show: show(advance=1))
            judges[name].maps(replay, pool)
            progress.advance(whole)
            if scenario.rules == rules and prior == "exact" and replay.glrm_hash() != mission.glrm_hash:
                progress.console.print(f"[yellow]{name} {scenario.seed}: `{rules}` makes another map than when it was "
                                       f"recorded at {mission.commit}: something has changed since[/]")  # fmt: skip
    return {name: {rules: pool.figures() for rules, pool in of.items()} for name, of in pools.items()}


@contextmanager
def _row(progress: Progress, what: str, total: float | None) -> Iterator[Callable[..., None]]:
    """A line of the progress view while something lasts."""
    row = progress.add_task(what, total=total)
    try:
        yield partial(progress.update, row)
    finally:
        progress.remove_task(row)


def changes(rule_sets: Sequence[str], seeds: int, progress: Progress) -> dict[str, dict[str, dict[str, float | None]]]:
    """Longest times to find and to clear over the seeds of the noise, by course and rule set."""
    out: dict[str, dict[str, dict[str, float | None]]] = {}
    for course in map_street.COURSES:
        times: dict[str, list[dict[str, float | None]]] = {rules: [] for rules in rule_sets}
        for seed in range(seeds):
            with _row(progress, f"{course.what}, robot {course.robot}, seed {seed}", None) as show:
                seen = list(map_street.views(course, seed))
                show(total=len(seen) * len(rule_sets))
                for rules in rule_sets:
                    times[rules].append(map_street.run_course(seen, course, rules, partial(show, advance=1)))
        out[f"{course.what} {course.robot}"] = {rules: map_street.worst(of) for rules, of in times.items()}
    return out


def _arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description="Judge the maps of recorded missions against the true scene.")
    parser.add_argument("--rules", default=RULES, help="rule sets, comma between; unknown ones are left out")
    parser.add_argument("--scenarios", default=SCENARIOS, help="folders under scenarios/, or paths")
    parser.add_argument("--priors", default=PRIORS, help="what the robots are told before: exact, honest, none")
    parser.add_argument("--seeds", type=int, default=3, help="missions a scenario: its own seed and those after it")
    parser.add_argument("--details", action="store_true", help="the robots' fine maps, distances and calibration too")
    parser.add_argument("--only", choices=("maps", "changes"), help="the recorded missions, or the made-up street")
    return parser.parse_args()


def _scenario(name: str) -> Scenario:
    path = Path("scenarios") / name
    return load_scenario(path if path.exists() else Path(name))


def main() -> int:
    """Print the tables, then the JSON line."""
    asked, console = _arguments(), Console(stderr=True)
    rules = tuple(name for name in asked.rules.split(",") if map_replay.has_rules(name))
    for name in set(asked.rules.split(",")) - set(rules):
        console.print(f"no rule set `{name}` here: left out")
    given = [_scenario(name) for name in asked.scenarios.split(",")]
    scenarios = tuple(resolve(s, None, s.seed + k, None) for s in given for k in range(asked.seeds))
    figures: dict[str, Any] = {}
    try:
        with Progress(console=console, transient=True) as progress:
            if asked.only != "changes":
                figures["maps"] = score(rules, asked.priors.split(","), scenarios, progress)
            if asked.only != "maps":
                figures["changes"] = changes(rules, asked.seeds, progress)
    except KeyboardInterrupt:
        console.print("interrupted; what was recorded is kept")
        return 130
    for table in map_tables.tables(figures, asked.details):
        Console(width=170).print(table)
    machine = {"cores": os.cpu_count(), "machine": platform.machine(), "python": platform.python_version()}
    print(json.dumps({**map_tables.json_ready(figures), "seeds": asked.seeds, **machine, "commit": commit()}))
    return 0


if __name__ == "__main__":
    sys.exit(main())
