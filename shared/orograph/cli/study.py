"""`orograph study`: one scenario with different numbers of robots, beside the paper's Table 3."""

from __future__ import annotations

import argparse
import math
from pathlib import Path

from rich.console import Console
from rich.table import Table
from rich.text import Text

from orograph.cli.run import shown
from orograph.errors import InputError
from orograph.launch.lifecycle import resolve, run
from orograph.storage.results import Study, StudyRow, Summary
from orograph.storage.run_folder import STUDY_PAGE, new_folder, write_whole
from orograph.storage.scenario_file import load_scenario


def add_parser(subparsers: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Declare the command's options."""
    parser = subparsers.add_parser(
        "study", help="compare numbers of robots, as the paper's Table 3",
        description="Run a scenario with each number of robots; writes study.json and study.html beside the runs.",
    )  # fmt: skip
    parser.add_argument("scenario", help="a folder, a scenario.yaml, or a name in ./scenarios")
    parser.add_argument("--robots", default="1,2,3", metavar="N,N,...", help="numbers of robots (default: 1,2,3)")
    parser.add_argument("--seed", type=int, metavar="S", help="seed of all randomness (default: the scenario's)")
    parser.add_argument("--out", type=Path, metavar="DIR", help="folder, new or empty (default: runs/study-<name>-NNN)")
    parser.add_argument("--in-process", action="store_true", help="all in one process over a simulated network")
    parser.add_argument("--quiet", action="store_true", help="no progress view")
    parser.set_defaults(main=main)


def main(args: argparse.Namespace) -> int:
    """Run every number of robots, print the table and say where the page is."""
    from orograph.judge.same_cells import same_cells_times_s
    from orograph.report.page import render_study  # heavy: only once the input is known to be good
    from orograph.report.study import study_rows

    asked = load_scenario(args.scenario)
    scenarios = [resolve(asked, count, args.seed, "max") for count in counts(args.robots)]
    out = new_folder(args.out, f"study-{asked.name}")
    summaries = []
    for scenario in scenarios:
        with shown(scenario, args.quiet) as on_progress:
            folder = run(scenario, out / f"robots-{scenario.robots}", in_process=args.in_process,
                         on_progress=on_progress)  # fmt: skip
        summaries.append((folder.name, Summary.read(folder)))
    rows = study_rows(summaries, same_cells_times_s([out / name for name, _ in summaries]))
    write_whole(out / STUDY_PAGE, render_study(asked.title, rows))
    Study(scenario=asked.name, rows=tuple(rows)).write(out)
    Console().print(table(asked.name, rows))
    print(f"study: {out / STUDY_PAGE}")
    return 0


def counts(text: str) -> list[int]:
    """Numbers of robots from `1,2,3`, ascending, each once; raises InputError."""
    try:
        return sorted({int(part) for part in text.split(",")})
    except ValueError:
        raise InputError(f"--robots {text}: expected numbers and commas such as 1,2,3") from None


def table(name: str, rows: list[StudyRow]) -> Table:
    """The paper's Table 3 with ours beside it."""
    # As Text: rich takes "[s]" in a string for markup and leaves it out.
    out = Table(title=Text(f"Mapping time on {name} [s of simulation, 95 % of the same cells]"))
    headings = "robots|paper [s]|paper speed-up|ours [s]|ours speed-up|coverage [%]|x real time"
    for heading in headings.split("|"):
        out.add_column(Text(heading), justify="right")
    for row in rows:
        figures = (
            (row.paper_s, 0), (row.paper_speed_up, 2), (row.mapping_s, 1), (row.speed_up, 2),
            (100 * row.coverage, 1), (row.rtf, 1),
        )  # fmt: skip
        out.add_row(
            str(row.robots),
            *("-" if value is None or math.isnan(value) else f"{value:.{digits}f}" for value, digits in figures),
        )
    return out
