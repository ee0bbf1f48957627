"""`orograph rerun`: a record's uplink fed to a fresh Map Manager, which must reach the recorded map."""

from __future__ import annotations

import argparse
from pathlib import Path

from orograph.errors import InputError


def add_parser(subparsers: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Declare the command's options."""
    parser = subparsers.add_parser(
        "rerun", help="make a recorded run's map again",
        description="Feed what the robots of a record sent to a Map Manager that knows nothing, and compare the maps.",
    )  # fmt: skip
    parser.add_argument("files", type=Path, nargs="+", metavar="FILE.mcap",
                        help="a run's record; several where the recorder was started again")  # fmt: skip
    parser.set_defaults(main=main)


def main(args: argparse.Namespace) -> int:
    """Say both hashes; 1 where they differ. Raises InputError for a file that is no record."""
    from orograph.record.reading import read_record
    from orograph.record.rerun import rerun

    records = [read_record(path) for path in args.files]
    if len({record.scenario.model_dump_json() for record in records}) > 1:
        raise InputError(f"{', '.join(map(str, args.files))}: records of different runs")
    found = rerun(records)
    cut = [str(path) for path, record in zip(args.files, records, strict=True) if not record.whole]
    recorded = found.recorded_hash or "none"
    print(f"{found.messages} messages of the robots make {found.reached_hash}; recorded: {recorded}"
          f"{''.join(f'; {path} was cut short' for path in cut)}")  # fmt: skip
    return 0 if found.agrees else 1
