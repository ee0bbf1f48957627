"""How safe is a mission? Many seeds of a scenario in this process, their collisions counted: `make contacts`.

    contacts.py --scenarios tiny,helsinki,paper --seeds 100 --first 1 --robots 3

Prints one line for each mission in which anything happened, a table, and a last JSON line; exits 1 if a robot was hit.
"""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Mapping
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from orograph.launch.in_process import build_rounds
from orograph.launch.lifecycle import resolve
from orograph.nodes.world import WorldNode
from orograph.runtime.rounds import Rounds
from orograph.scenario import Scenario
from orograph.storage.recording import Recording
from orograph.storage.run_folder import STORE
from orograph.storage.scenario_file import load_scenario
from orograph.storage.sqlite_store import SqliteStore
from rich.console import Console
from rich.table import Table

TOLD = ("contact", "robot-tipped", "gave-up", "wheels-spin")
"""Events that a line is printed for."""


@dataclass
class Outcome:
    """What came of one mission."""

    scenario: str
    seed: int
    complete: bool = False
    sim_time_s: float = 0.0
    events: list[dict[str, Any]] = field(default_factory=list)

    def note(self, stamp_ns: int, node: str, kind: str, fields: Mapping[str, Any]) -> None:
        """Keep what matters here of a mission's events."""
        if kind in (*TOLD, "stuck"):
            self.events.append({"t_s": stamp_ns * 1e-9, "node": node, "event": kind, **fields})

    def count(self) -> Counter[str]:
        """How often each kind of event happened."""
        return Counter(e["event"] for e in self.events)


def mission(scenario: Scenario) -> Outcome:
    """Run one to its end."""
    outcome = Outcome(scenario.name, scenario.seed)
    with tempfile.TemporaryDirectory() as folder, Recording(Path(folder), "in-process") as recording:
        rounds = build_rounds(scenario, SqliteStore(Path(folder) / STORE, scenario.grid.grid.shape), recording, {})
        watched = Rounds(scenario.frame_ns, rounds.nodes, rounds.network, outcome.note)
        world = next(n for n in watched.nodes if isinstance(n, WorldNode))
        while world.ended is None:
            watched.step()
    outcome.complete, outcome.sim_time_s = world.ended.complete, watched.stamp_ns * 1e-9
    return outcome


def _row(name: str, outcomes: list[Outcome]) -> dict[str, Any]:
    total = sum((o.count() for o in outcomes), Counter[str]())
    return {
        "scenario": name, "missions": len(outcomes), "hit": sum("contact" in o.count() for o in outcomes),
        **{kind: total[kind] for kind in (*TOLD, "stuck")}, "complete": sum(o.complete for o in outcomes),
        "mean_s": round(sum(o.sim_time_s for o in outcomes) / len(outcomes), 1),
    }  # fmt: skip


def main() -> int:
    """Run the missions asked for and print what came of them."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--scenarios", default="tiny,helsinki,paper")
    parser.add_argument("--seeds", type=int, default=10, help="how many of each (default: 10)")
    parser.add_argument("--first", type=int, default=1, help="the first seed (default: 1)")
    parser.add_argument("--robots", type=int, help="default: the scenario's")
    parser.add_argument("--jobs", type=int, default=1, help="missions at a time (default: 1)")
    args = parser.parse_args()
    console, rows, begin_s = Console(), [], time.monotonic()
    with ProcessPoolExecutor(args.jobs) as pool:
        for name in args.scenarios.split(","):
            asked = load_scenario(name)
            seeds = range(args.first, args.first + args.seeds)
            outcomes = []
            for outcome in pool.map(mission, [resolve(asked, args.robots, seed, "max") for seed in seeds]):
                outcomes.append(outcome)
                for event in outcome.events:
                    if event["event"] in TOLD:
                        console.print_json(json.dumps({"scenario": name, "seed": outcome.seed, **event}), indent=None)
                if not outcome.complete:
                    console.print(f"{name} seed {outcome.seed}: not complete after {outcome.sim_time_s:.0f} s")
            rows.append(_row(name, outcomes))
    table = Table(*rows[0])
    for row in rows:
        table.add_row(*(str(value) for value in row.values()))
    console.print(table)
    print(json.dumps({"wall_s": round(time.monotonic() - begin_s), "rows": rows}))
    return 1 if any(row["hit"] for row in rows) else 0


if __name__ == "__main__":
    sys.exit(main())
