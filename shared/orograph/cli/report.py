"""`orograph report`: make a run folder's report again from the parts it holds."""

from __future__ import annotations

import argparse
from pathlib import Path


def add_parser(subparsers: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Declare the command's options."""
    parser = subparsers.add_parser(
        "report", help="make a run's report again",
        description="Score a run again from the parts in its folder; writes report.html and summary.json anew.",
    )  # fmt: skip
    parser.add_argument("folder", type=Path, help="run folder, as `orograph run` leaves it")
    parser.set_defaults(main=main)


def main(args: argparse.Namespace) -> int:
    """Compose the folder anew and say where the report is; raises InputError for a folder without a run."""
    from orograph.report.folder import compose  # heavy: only once there is something to do
    from orograph.storage.run_folder import REPORT

    compose(args.folder)
    print(args.folder / REPORT)
    return 0
