"""`orograph run`: one mission from a scenario to a finished run folder."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from orograph.cli.progress import Progress
from orograph.errors import InputError
from orograph.launch.lifecycle import resolve, run
from orograph.launch.processes import free_port
from orograph.launch.progress import OnProgress, unseen
from orograph.scenario import Scenario
from orograph.storage.results import Summary
from orograph.storage.run_folder import REPORT
from orograph.storage.scenario_file import load_scenario


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
    parser.add_argument("--view", nargs="?", type=int, const=0, metavar="PORT",
                        help="show the run in a browser, on this port of 127.0.0.1 (default: a free one)")  # fmt: skip
    parser.add_argument("--record", action="store_true", help="leave the run as an MCAP file in its folder")
    parser.add_argument("--quiet", action="store_true", help="no progress view")
    parser.set_defaults(main=main)


def main(args: argparse.Namespace) -> int:
    """Run and say where the report is."""
    scenario = resolve(load_scenario(args.scenario), args.robots, args.seed, args.time_scale)
    if args.capacity < 0:
        raise InputError(f"--capacity {args.capacity}: expected 1 or more robots per process, or 0 for the default")
    if args.view is not None and args.in_process:
        raise InputError("--view: what runs in one process is seen afterwards, by `orograph view`; leave --in-process")
    if args.record and args.in_process:
        raise InputError("--record: what runs in one process sends nothing that could be heard; leave --in-process")
    ports = (args.sim_port, args.radio_port)
    page_port = None if args.view is None else free_port(args.view)
    if page_port is not None:
        print(f"see it: http://127.0.0.1:{page_port}", flush=True)
    with shown(scenario, args.quiet) as on_progress:
        out = run(scenario, args.out, in_process=args.in_process, capacity=args.capacity, ports=ports,
                  on_progress=on_progress, page_port=page_port, record=args.record)  # fmt: skip
    summary = Summary.read(out)
    copies = "all copies equal" if summary.copies_hash_equal else "COPIES DIFFER"
    print(f"map {summary.glrm_hash} · {copies} · {summary.sim_time_s:.0f} s of simulation "
          f"in {summary.wall_time_s:.1f} s\nreport: {out / REPORT}\nsee it again: orograph view {out}")  # fmt: skip
    for line in lacking(summary):
        print(line, file=sys.stderr)
    return 0 if summary.complete else 1


def lacking(summary: Summary) -> Iterator[str]:
    """What a run did not do, and what it should not have done, a line each."""
    for c in summary.contacts:
        yield f"collision: {c.robot} and {c.body} after {c.since_s:.1f} s, {c.newtons:,.0f} N for {c.seconds:.1f} s"
    if summary.robots_revoked:
        yield f"revoked: {', '.join(summary.robots_revoked)}; nothing of theirs is in the map"
    if not summary.complete:
        missed = summary.waypoints_missed or ()
        what = [f"{len(missed)} of {summary.waypoints} waypoints not visited ({', '.join(map(str, missed))})"]
        what = what if missed else ["a robot never brought its last cells home"]
        yield f"incomplete: {what[0]}; coverage {summary.coverage:.1%} of what the patrol can see"


@contextmanager
def shown(scenario: Scenario, quiet: bool) -> Iterator[OnProgress]:
    """The live view while a run goes on, unless nobody wants one."""
    if quiet:
        yield unseen
        return
    with Progress(scenario) as progress:
        yield progress.show
