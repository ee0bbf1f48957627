"""`orograph fleet`: a scenario folder with a made-up town for any number of robots."""

from __future__ import annotations

import argparse
from pathlib import Path

from orograph.errors import InputError
from orograph.messages import ROBOTS_MAX

SEED_MAX = 2**31 - 1


def add_parser(subparsers: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Declare the command's options."""
    parser = subparsers.add_parser(
        "fleet", help="make a scenario for a fleet of any size",
        description="Make a scenario folder: a town sized for N robots, starts and a patrol on its streets.",
    )  # fmt: skip
    parser.add_argument("robots", type=int, metavar="N", help=f"how many robots drive, 1 to {ROBOTS_MAX}")
    parser.add_argument("--out", type=Path, required=True, metavar="DIR", help="scenario folder, new or empty")
    parser.add_argument("--seed", type=int, default=1, metavar="S", help="of the town and of its runs (default: 1)")
    parser.set_defaults(main=main)


def main(args: argparse.Namespace) -> int:
    """Draw, write, say how large it is; raises InputError for a fleet that no scenario holds."""
    from orograph.importers import fleet
    from orograph.importers.scenario import require_new, write

    if not 1 <= args.robots <= ROBOTS_MAX:
        raise InputError(f"fleet {args.robots}: a scenario holds 1 to {ROBOTS_MAX} robots; ask for so many")
    if not 0 <= args.seed <= SEED_MAX:
        raise InputError(f"--seed {args.seed}: expected 0 to {SEED_MAX}")
    require_new(args.out)
    content, houses = fleet.content(args.out.name, args.robots, args.seed)
    write(args.out, content, houses, fleet.readme(content, len(houses)))
    print(f"{args.out}: {len(houses)} buildings, {len(content['patrol'])} waypoints, "
          f"{len(content['starts'])} starts, {content['duration_max_s']} s at most")  # fmt: skip
    return 0
