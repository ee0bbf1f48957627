"""`orograph status`: how a running cluster stands, asked of its orchestrator over the radio plane."""

from __future__ import annotations

import argparse
import time
from collections.abc import Iterator
from contextlib import contextmanager
from threading import Event

from pydantic import ValidationError
from rich.console import Console, Group
from rich.live import Live
from rich.table import Table
from rich.text import Text

from orograph import keys
from orograph.comms import wire
from orograph.comms.bus import Bus
from orograph.comms.session import client
from orograph.errors import InputError, RunError
from orograph.fields import Rejected
from orograph.nodes.standing import MapStanding, RobotStanding, Standing, link_up

ROUTER = "tcp/127.0.0.1:17448"
"""Where ops/status.compose.yaml publishes the radio plane's router."""
ANSWER_S = 2.0
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
    parser.add_argument(
        "--router", default=ROUTER, metavar="ENDPOINT",
        help="the radio plane's router: tcp/HOST:PORT (default: %(default)s)",
    )  # fmt: skip
    parser.add_argument("--watch", action="store_true", help="again every second, until Ctrl-C")
    parser.add_argument("--json", action="store_true", help="as JSON, one line an answer")
    parser.set_defaults(main=main)


def check_endpoint(text: str) -> None:
    """Raise InputError for what is no endpoint."""
    protocol, _, address = text.partition("/")
    host, _, port = address.rpartition(":")
    if protocol != "tcp" or not host or not port.isdecimal() or not 0 < int(port) < 65536:
        raise InputError(f"--router {text}: expected tcp/HOST:PORT, as {ROUTER}")


def main(args: argparse.Namespace) -> int:
    """Ask once, or every second; raises InputError, and RunError where nobody answers."""
    check_endpoint(args.router)
    with _router(args.router) as bus:
        if args.watch:
            watch(bus, args.router, args.json)
        else:
            standing = ask(bus, args.router)
            print(standing.model_dump_json()) if args.json else Console().print(view(standing))
    return 0


@contextmanager
def _router(endpoint: str) -> Iterator[Bus]:
    once = Event()
    once.set()
    try:
        with client(endpoint, once) as session:
            yield Bus({keys.RADIO: session})
    except InterruptedError:
        raise RunError(f"no router answers at {endpoint}: is the cluster up, and its radio port published?") from None


def ask(bus: Bus, endpoint: str) -> Standing:
    """How the cluster stands; raises RunError where nobody says, or what is said is not understood."""
    reply = bus.ask(keys.STATUS, b"", ANSWER_S, keys.RADIO)
    if reply is None:
        raise RunError(f"the router at {endpoint} is up, but no orchestrator answers through it: no run is going on")
    try:
        told = wire.unpack_plain(reply)
        if told is None:
            raise RunError("the cluster is starting: its first second has not come yet")
        return Standing.model_validate({**told, "robots": tuple(told["robots"])})
    except (Rejected, ValidationError, TypeError, KeyError):
        raise RunError(f"what answers at {endpoint} is no orchestrator of this program's version") from None


def watch(bus: Bus, endpoint: str, as_json: bool) -> None:
    """Show it anew every second until Ctrl-C; on a terminal silence is shown, elsewhere it ends the watch."""
    console = Console()
    try:
        if as_json or not console.is_terminal:
            while True:
                standing = ask(bus, endpoint)
                print(standing.model_dump_json() if as_json else headline(standing).plain, flush=True)
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


def view(standing: Standing) -> Group:
    """The headline over a table of robots."""
    return Group(headline(standing), Text(), _robots(standing))


def headline(standing: Standing) -> Text:
    """Run, simulation time, phase, coverage and the manager's map."""
    manager = standing.manager
    held = f"version {manager.version}, {manager.hash[:HASH_SHOWN]}" if manager else "not heard yet"
    if manager and not link_up(manager.silent_s):
        held += f" ({_silence(manager.silent_s)})"
    name = standing.scenario if standing.run in (".", "") else standing.run
    return Text(
        f"{name}   {standing.sim_time_s:.0f} s simulated, {standing.phase}   map {standing.coverage:.1%} of the area, "
        f"{held}   {standing.waypoints_left} waypoints left",
        "bold",
    )


def _robots(standing: Standing) -> Table:
    names = ("robot", " ".join(WORKERS), "radio", "state", "goals", "backlog", "version", "copy's hash")
    table = Table(*names, box=None, pad_edge=False, padding=(0, 1, 0, 0))
    for column in table.columns:
        column.no_wrap = column.header != "radio"
    for robot in standing.robots:
        copy, backlog = robot.copy_held, robot.backlog_cells
        table.add_row(
            robot.robot, workers(robot), radio(robot), robot.state or "-", str(robot.waypoints_left),
            "-" if backlog is None else str(backlog), str(copy.version) if copy else "-",
            agreement(copy, standing.manager),
        )  # fmt: skip
    return table


def workers(robot: RobotStanding) -> Text:
    """The instances that hold the robot's services; what nobody holds is red."""
    held = [robot.workers.get(service, "") for service in WORKERS.values()]
    return Text(" ").join(Text(i[:INSTANCE_SHOWN]) if i else Text("none", "red") for i in held)


def radio(robot: RobotStanding) -> Text:
    """Whether the two services on the radio plane are heard, and for how long the silent one has not been."""
    silent = {keys.MAPPING: robot.copy_held.silent_s if robot.copy_held else None, keys.NAVIGATOR: robot.drive_silent_s}
    down = {service: _silence(s) for service, s in silent.items() if not link_up(s)}
    if len(down) == 1:
        return Text(" ".join(next(iter(down.items()))), "red")
    return Text(max(down.values(), key=len), "red") if down else Text("up", "green")


def _silence(silent_s: float | None) -> str:
    return "never heard" if silent_s is None else f"down {silent_s:.0f} s"


def agreement(copy: MapStanding | None, manager: MapStanding | None) -> Text:
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
