"""`orograph import-osm`: a scenario folder from a piece of an OpenStreetMap extract."""

from __future__ import annotations

import argparse
from pathlib import Path

from orograph.cli.errors import InputError


def add_parser(subparsers: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Declare the command's options."""
    parser = subparsers.add_parser(
        "import-osm", help="make a scenario from an OpenStreetMap extract",
        description="Make a scenario folder from the buildings and streets of an OpenStreetMap extract.",
    )  # fmt: skip
    parser.add_argument(
        "file", type=Path, metavar="FILE.osm.pbf", help="an extract, for instance of download.geofabrik.de"
    )
    parser.add_argument(
        "--bbox", required=True, metavar="W,S,E,N", help="the district: west,south,east,north in degrees"
    )
    parser.add_argument("--out", type=Path, required=True, metavar="DIR", help="scenario folder, new or empty")
    parser.add_argument("--name", help="the scenario's name (default: the folder's)")
    parser.add_argument("--title", help="the scenario's title (default: made from its name)")
    parser.add_argument("--robots", type=int, default=3, metavar="N", help="how many robots drive (default: 3)")
    parser.add_argument("--waypoints", type=int, default=20, metavar="N", help="waypoints of the patrol (default: 20)")
    parser.set_defaults(main=main)


def main(args: argparse.Namespace) -> int:
    """Read, choose, write, and say whose map it is; raises InputError for what can't be imported."""
    raise InputError(f"{args.file}: not imported")
