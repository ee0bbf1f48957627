"""`orograph status`: how a running cluster stands, asked of its orchestrator over the radio plane."""

from __future__ import annotations

import argparse
import dataclasses
import json
import time

from rich.console import Console, Group
from rich.live import Live
from rich.table import Table
from rich.text import Text

from orograph import keys
from orograph.cli import radio
from orograph.cli.radio import ANSWER_S
from orograph.comms.bus import Bus
from orograph.control import ClusterStatus, HeldMap, RobotState
from orograph.errors import RunError
from orograph.nodes.status_board import link_up

WATCH_EVERY_S = 1.0
INSTANCE_SHOWN = 4
HASH_SHOWN = 6
WORKERS = {"las.": keys.LASER, "map.": keys.MAPPING, "nav.": keys.NAVIGATOR}
"""Heads of the column of workers."""


def add_parser(subparsers: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Declare the command's options."""
    parser = subparsers.add_parser(
        "status",
        help="show how a running cluster stands",
        description="Ask a running cluster and show its robots, their workers, links, backlog and copies of the map.",
    )
    radio.add_option(parser)
    parser.add_argument("--watch", action="store_true", help="again every second, until Ctrl-C")
    parser.add_argument("--json", action="store_true", help="as JSON, one line an answer")
    parser.set_defaults(main=main)


def main(args: argparse.Namespace) -> int:
    """Ask once, or every second; raises InputError, and RunError where nobody answers."""
    with radio.router(args.router) as bus:
        if args.watch:
            watch(bus, args.router, args.json)
        else:
            status = ask(bus, args.router)
            print(as_json(status)) if args.json else Console().print(view(status))
    return 0


def ask(bus: Bus, endpoint: str) -> ClusterStatus:
    """How the cluster stands; raises RunError where nobody says, or what is said is not understood."""
    status = bus.ask(keys.STATUS, None, ClusterStatus, ANSWER_S, keys.RADIO)
    if status is None and bus.callbacks.figures():
        raise RunError(f"what answers at {endpoint} is no orchestrator of this program's version")
    if status is None:
        raise RunError(f"the router at {endpoint} is up, but no orchestrator answers through it: no run is going on")
    if status.phase == "starting":
        raise RunError("the cluster is starting: its first second has not come yet")
    return status


def as_json(status: ClusterStatus) -> str:
    """One line."""
    return json.dumps(dataclasses.asdict(status))


def watch(bus: Bus, endpoint: str, in_json: bool) -> None:
    """Show it anew every second until Ctrl-C; on a terminal silence is shown, elsewhere it ends the watch."""
    console = Console()
    try:
        if in_json or not console.is_terminal:
            while True:
                status = ask(bus, endpoint)
                print(as_json(status) if in_json else headline(status).plain, flush=True)
                time.sleep(WATCH_EVERY_S)
        with Live(view(ask(bus, endpoint)), console=console, auto_refresh=False) as live:
            while True:
                time.sleep(WATCH_EVERY_S)
                live.update(_view_or_silence(bus, endpoint), refresh=True)
    except KeyboardInterrupt:
        return


def _view_or_silence(bus: Bus, endpoint: str) -> Group | Text:
    try:
        return view(ask(bus, endpoint))
    except RunError as error:
        return Text(f"{error}; asking again", "yellow")


def view(status: ClusterStatus) -> Group:
    """The headline over a table of robots."""
    return Group(headline(status), Text(), _robots(status))


def headline(status: ClusterStatus) -> Text:
    """Run, simulation time, phase, coverage and the manager's map."""
    manager = status.manager
    held = f"version {manager.version}, {manager.hash[:HASH_SHOWN]}" if manager else "not heard yet"
    if manager and not link_up(manager.silent_s):
        held += f" ({_silence(manager.silent_s)})"
    name = status.scenario if status.run in (".", "") else status.run
    return Text(
        f"{name}   {status.sim_time_s:.0f} s simulated, {status.phase}   map {status.coverage:.1%} of the area, "
        f"{held}   {status.waypoints_left} waypoints left",
        "bold",
    )


def _robots(status: ClusterStatus) -> Table:
    names = ("robot", " ".join(WORKERS), "radio", "state", "goals", "backlog", "version", "copy's hash")
    table = Table(*names, box=None, pad_edge=False, padding=(0, 1, 0, 0))
    for column in table.columns:
        column.no_wrap = column.header != "radio"
    for robot in status.robots:
        copy, backlog = robot.copy_held, robot.backlog_cells
        table.add_row(
            robot.robot, workers(robot), link(robot), "revoked" if robot.revoked else robot.state or "-",
            str(robot.waypoints_left), "-" if backlog is None else str(backlog), str(copy.version) if copy else "-",
            agreement(copy, status.manager),
        )  # fmt: skip
    return table


def workers(robot: RobotState) -> Text:
    """The instances that hold the robot's services; what nobody holds is red."""
    held = [robot.workers.get(service, "") for service in WORKERS.values()]
    return Text(" ").join(Text(i[:INSTANCE_SHOWN]) if i else Text("none", "red") for i in held)


def link(robot: RobotState) -> Text:
    """Whether the two services on the radio plane are heard, and for how long the silent one has not been."""
    silent = {keys.MAPPING: robot.copy_held.silent_s if robot.copy_held else None, keys.NAVIGATOR: robot.drive_silent_s}
    down = {service: _silence(s) for service, s in silent.items() if not link_up(s)}
    if len(down) == 1:
        return Text(" ".join(next(iter(down.items()))), "red")
    return Text(max(down.values(), key=len), "red") if down else Text("up", "green")


def _silence(silent_s: float | None) -> str:
    return "never heard" if silent_s is None else f"down {silent_s:.0f} s"


def agreement(copy: HeldMap | None, manager: HeldMap | None) -> Text:
    """A copy's hash, and whether it is the manager's, on its way there, or different at the same version."""
    if copy is None or manager is None:
        return Text("-")
    shown = copy.hash[:HASH_SHOWN]
    if copy.hash == manager.hash:
        return Text(f"{shown} equal", "green")
    if copy.version == manager.version:
        return Text(f"{shown} DIFFERS", "bold red")
    # The manager and the robots report once a second each: a copy may be newer than what the manager last said.
    return Text(f"{shown} {'behind' if copy.version < manager.version else 'newer'}")
