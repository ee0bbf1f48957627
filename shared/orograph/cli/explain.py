"""`orograph explain`: whose registers made a cell of a run's map, when, and what the fold decided."""

from __future__ import annotations

import argparse
from pathlib import Path

from rich.console import Console, Group
from rich.table import Table
from rich.text import Text

from orograph import keys
from orograph.arrays import I64
from orograph.errors import InputError
from orograph.grid import Grid
from orograph.launch.stored_map import stored_map
from orograph.layers import CONFIDENCE, CONFIDENCE_TOP, MAPPED, MAPPED_LAYERS
from orograph.protocol.explained import PRIOR, Explanation, Step, explain

ONE_SURFACE = {"height": "height", "slope x": "gradient_x", "slope y": "gradient_y", "occupied": "occupation"}
TWO_SURFACES = {
    "ground": "height", "top": "height_top", "walls": "wall_share", "free": "free_share", "occupied": "occupation"
}  # fmt: skip
"""Heads of columns and the layers that they show, by rules of one surface and of two."""
WIDTH = 120
"""Characters that the widest table needs."""


def add_parser(subparsers: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Declare the command's options."""
    parser = subparsers.add_parser(
        "explain",
        help="say how a cell of a run's map came about",
        description="Show whose registers made a cell of a run's global map, when, and what the fold decided.",
    )
    parser.add_argument("folder", type=Path, help="run folder, as `orograph run` leaves it")
    where = parser.add_mutually_exclusive_group(required=True)
    where.add_argument("--cell", metavar="ROW,COL", help="the cell: rows from the south, columns from the west, from 0")
    where.add_argument("--at", metavar="X,Y", help="the cell that holds this point [m, map frame]")
    parser.set_defaults(main=main)


def main(args: argparse.Namespace) -> int:
    """Print the table; raises InputError for a cell that there is not, or a folder without a map."""
    with stored_map(args.folder) as stored:
        grid = stored.scenario.grid.grid
        row, col = by_index(grid, args.cell) if args.cell is not None else by_place(grid, args.at)
        cell, registers = row * grid.cols + col, stored.ledger.registers()
        found = explain(stored.prior[cell], registers[registers["cell"] == cell], stored.rules)
    console = Console()
    console.width = max(console.width, WIDTH)
    console.print(view(found, grid, stored.rules.two_surfaces))
    return 0


def by_index(grid: Grid, text: str) -> tuple[int, int]:
    """The cell (row, col) of `--cell`; raises InputError where there is none."""
    try:
        row, col = (int(part) for part in text.split(","))
    except ValueError:
        raise InputError(f"--cell {text}: expected ROW,COL as 12,7") from None
    if not (0 <= row < grid.rows and 0 <= col < grid.cols):
        raise InputError(f"--cell {text}: rows are 0 to {grid.rows - 1}, columns 0 to {grid.cols - 1}")
    return row, col


def by_place(grid: Grid, text: str) -> tuple[int, int]:
    """The cell (row, col) of `--at`; raises InputError where there is none."""
    try:
        x_m, y_m = (float(part) for part in text.split(","))
        found = grid.row_col(x_m, y_m)
    except (ValueError, OverflowError):
        raise InputError(f"--at {text}: expected X,Y in metres as 62.5,12.5") from None
    if found is None:
        x0, y0, x1, y1 = grid.extent_m
        raise InputError(f"--at {text}: the map reaches from {x0:g},{y0:g} to {x1:g},{y1:g}")
    return found


def view(found: Explanation, grid: Grid, two_surfaces: bool) -> Group:
    """Where the cell lies, over a table of its contributions in the order of the fold and what they make."""
    columns = TWO_SURFACES if two_surfaces else ONE_SURFACE
    ends = ("sure", "of top", "driving", "ground") if two_surfaces else ("sure", "decided")
    table = Table("from", "after", "epoch/seq", *columns, *ends, box=None, pad_edge=False, padding=(0, 2, 0, 0))
    for step in found.steps:
        sure = [aged(step.said, CONFIDENCE, step.weight)]
        sure += [aged(step.said, CONFIDENCE_TOP, step.top_weight), step.bars] if two_surfaces else []
        table.add_row(*whose(step), *shown(step.said, columns), *sure, step.decided)
    sure = [str(found.result[k]) for k in (CONFIDENCE, CONFIDENCE_TOP)[: 1 + two_surfaces]]
    table.add_row("the map", "", "", *shown(found.result, columns), *sure, style="bold")
    return Group(headline(found, grid), Text(), table)


def headline(found: Explanation, grid: Grid) -> Text:
    """The cell's indices, its place, and of how many robots it is."""
    row, col = divmod(found.cell, grid.cols)
    x_m, y_m = grid.centre_m(row, col)
    robots = len(found.steps) - 1
    made = f"folded from the prior and {robots} robot{'s' * (robots != 1)}" if robots else "the prior's alone"
    return Text(f"cell {row},{col} round {x_m:g},{y_m:g} m: {made}", "bold")


def whose(step: Step) -> tuple[str, str, str]:
    """The contributor, when, and which of its registers."""
    if step.robot == PRIOR:
        return "prior", "-", "-"
    return keys.robot_id(step.robot), f"{step.tick_ms / 1000:.1f} s", f"{step.epoch}/{step.seq}"


def shown(cell: I64, columns: dict[str, str]) -> list[str]:
    """These layers of a cell (WIDTH,) in their units; a dash for what is unknown."""
    return [_text(cell, MAPPED_LAYERS.index(name)) for name in columns.values()]


def _text(cell: I64, layer: int) -> str:
    kind = MAPPED[layer]
    digits = 3 if kind.step <= 1e-3 else 2
    return "-" if cell[layer] == kind.unknown else f"{cell[layer] * kind.step:.{digits}f}"


def aged(cell: I64, layer: int, weight: float) -> str:
    """A confidence as it was said, and as it counts where that differs."""
    said = int(cell[layer])
    return str(said) if said == weight else f"{said} -> {weight:.0f}"
