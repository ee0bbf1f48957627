"""The `orograph` command: one line for what went wrong, exit code 2 for input, 1 for failure, 130 for Ctrl-C."""

from __future__ import annotations

import argparse
import logging
import re
import sys
from collections.abc import Sequence

from orograph.cli import (
    doctor,
    explain,
    export,
    fleet,
    import_osm,
    map_scans,
    report,
    rerun,
    revoke,
    run,
    status,
    store,
    study,
    view,
)  # fmt: skip
from orograph.errors import InputError, RunError
from orograph.storage.scenario_file import ScenarioError


def parser() -> argparse.ArgumentParser:
    """The command line."""
    top = argparse.ArgumentParser(
        prog="orograph", description="Robots with 3D lasers build one layered 2.5D map together, over links that drop."
    )
    subparsers = top.add_subparsers(title="commands", metavar="COMMAND", required=True)
    making, looking = (import_osm, fleet, map_scans, export), (study, report, explain, rerun)
    for command in (run, view, status, revoke, store, *looking, *making, doctor):
        command.add_parser(subparsers)
    return top


def glued(argv: Sequence[str]) -> list[str]:
    """`--bbox -73.99,40.7` as `--bbox=-73.99,40.7`: argparse takes what begins with a minus for an option."""
    out: list[str] = []
    for word in argv:
        if re.match(r"-\d", word) and out and re.fullmatch(r"--[a-z-]+", out[-1]):
            out[-1] += f"={word}"
        else:
            out.append(word)
    return out


def main(argv: Sequence[str] | None = None) -> int:
    """Run one command; returns its exit code."""
    args = parser().parse_args(glued(sys.argv[1:] if argv is None else argv))
    logging.basicConfig(level=logging.ERROR)
    try:
        return int(args.main(args))
    except (InputError, ScenarioError) as error:
        print(f"orograph: {error}", file=sys.stderr)
        return 2
    except RunError as error:
        print(f"orograph: {error}", file=sys.stderr)
        return 1
    except BrokenPipeError:  # `orograph run ... | head -1`: who reads has read enough
        sys.stdout = None
        return 0
    except KeyboardInterrupt:
        print("\norograph: interrupted; every process it started has ended", file=sys.stderr)
        return 130


if __name__ == "__main__":
    sys.exit(main())
