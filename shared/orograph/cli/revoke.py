"""`orograph revoke`: take everything that a robot ever said out of the map, and take nothing more from it."""

from __future__ import annotations

import argparse
import time
from pathlib import Path

from orograph import keys
from orograph.cli import radio
from orograph.comms.bus import Bus
from orograph.control import Revoke, Revoked
from orograph.errors import InputError, RunError
from orograph.launch.stored_map import revoke_stored
from orograph.storage.run_folder import RUN

CONFIRMED_WITHIN_S = 15.0
AGAIN_S = 0.2


def add_parser(subparsers: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Declare the command's options."""
    parser = subparsers.add_parser(
        "revoke",
        help="take a robot out of the map for good",
        description="Take all that a robot has reported out of the map, of a running mission or of a run folder, "
        "and refuse it from then on. There is no way back.",
    )
    parser.add_argument("robot", help="robot_001, ...")
    parser.add_argument("--run", type=Path, metavar="DIR", help="a run folder that no mission uses, not a running one")
    radio.add_option(parser)
    parser.set_defaults(main=main)


def main(args: argparse.Namespace) -> int:
    """Revoke and say so; raises InputError for a robot that there is not, RunError where nobody confirms it."""
    if not keys.ROBOT_ID.fullmatch(args.robot):
        raise InputError(f"{args.robot}: expected a robot's name as robot_001")
    if args.run is not None:
        print(in_folder(args.run, args.robot))
        return 0
    with radio.router(args.router) as bus:
        in_mission(bus, args.robot, args.router)
    print(f"{args.robot} is revoked: nothing of it is in the map, and nothing is taken from it any more")
    return 0


def in_folder(out: Path, robot: str) -> str:
    """Revoke in the store of a run folder and, where there is a report, make that anew; what was done."""
    from orograph.report.folder import compose  # heavy: only once there is something to do

    changed = revoke_stored(out, robot)
    if (out / RUN).exists():
        compose(out)
    return f"{robot} is revoked: {changed} cells of the map in {out} changed"


def in_mission(bus: Bus, robot: str, endpoint: str) -> None:
    """Ask until the map manager says that it would survive kill -9."""
    answer: Revoked | None = None
    deadline_s = time.monotonic() + CONFIRMED_WITHIN_S
    while time.monotonic() < deadline_s:
        answer = bus.ask(keys.REVOKE, Revoke(robot), Revoked, radio.ANSWER_S, keys.RADIO) or answer
        if answer is not None and answer.reason:
            raise InputError(answer.reason)
        if answer is not None and robot in answer.robots:
            return
        time.sleep(AGAIN_S)
    if answer is None:
        raise RunError(f"the router at {endpoint} is up, but no map manager answers through it: is a run going on?")
    raise RunError(f"the map manager heard of it and has not done it within {CONFIRMED_WITHIN_S:.0f} s: "
                   "is the run paused, or its disk full? Ask again")  # fmt: skip
