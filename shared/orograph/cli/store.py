"""`orograph store`: look through the map store of a run, copy it away while the run goes on, put a copy back."""

from __future__ import annotations

import argparse
from collections import Counter
from pathlib import Path

import numpy as np
from rich.console import Console
from rich.table import Table

from orograph import keys
from orograph.launch.kept_store import Kept, Restored, back_up, check, restore
from orograph.protocol.store import StoredState


def add_parser(subparsers: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Declare the command's options."""
    parser = subparsers.add_parser(
        "store",
        help="check, back up or restore the map store of a run",
        description="Look after the map manager's durable store, one SQLite file in a run's folder.",
    )
    actions = parser.add_subparsers(title="actions", metavar="ACTION", required=True)
    checking = actions.add_parser("check", help="verify every row, and say what is held")
    checking.add_argument("place", type=Path, metavar="DIR|FILE", help="run folder, or a store's file")
    checking.set_defaults(main=main_check)
    backing = actions.add_parser("backup", help="write a whole copy, also while a manager holds the store")
    backing.add_argument("place", type=Path, metavar="DIR", help="run folder")
    backing.add_argument("--to", type=Path, metavar="FILE", required=True, help="a new file")
    backing.set_defaults(main=main_backup)
    restoring = actions.add_parser("restore", help="put a backup into a run folder that no mission uses")
    restoring.add_argument("file", type=Path, metavar="FILE", help="what `orograph store backup` wrote")
    restoring.add_argument("--to", type=Path, metavar="DIR", required=True, help="run folder")
    restoring.add_argument("--force", action="store_true", help="even if what is there is newer, which is then lost")
    restoring.set_defaults(main=main_restore)


def main_check(args: argparse.Namespace) -> int:
    """Print what is held; raises InputError, and RunError where the store is damaged."""
    kept = check(args.place)
    print("\n".join(lines(kept)))
    if kept.held.registers or kept.held.granted:
        Console().print(robots(kept.held))
    return 0


def main_backup(args: argparse.Namespace) -> int:
    """Write it and say what is in it; raises InputError and RunError."""
    kept = back_up(args.place, args.to)
    print(f"{args.to} is a whole copy of {kept.path}: {_commit(kept.held)}")
    return 0


def main_restore(args: argparse.Namespace) -> int:
    """Put it back and say what that means; raises InputError and RunError."""
    print("\n".join(consequences(restore(args.file, args.to, args.force), args.to)))
    return 0


def lines(kept: Kept) -> list[str]:
    """Which run, which commit, how much, who is revoked, and the map's hash."""
    held, scenario = kept.held, kept.scenario
    cells = np.unique(np.concatenate([np.zeros(0, "<u4"), *(rows["cell"] for rows in held.registers.values())]))
    run = f"{scenario.name}, seed {scenario.seed}, {scenario.robots} robots" if scenario else "not known of a lone file"
    return [
        f"{kept.path}: whole",
        f"run       {run}",
        f"commit    {_commit(held)}",
        f"cells     {len(cells)} with {sum(map(len, held.registers.values()))} registers",
        f"revoked   {', '.join(map(keys.robot_id, sorted(held.revoked))) or 'nobody'}",
        f"map hash  {kept.map_hash() or 'not known of a lone file'}",
    ]


def robots(held: StoredState) -> Table:
    """Registers of each robot, and the epochs that it was given."""
    table = Table("robot", "registers", "lives", "epoch", box=None, pad_edge=False, padding=(0, 2, 0, 0))
    lives = Counter(grant.robot for grant in held.granted)
    epochs = {grant.robot: grant.epoch for grant in sorted(held.granted, key=lambda grant: grant.epoch)}
    for robot in sorted({*held.registers, *lives}):
        registers = len(held.registers.get(robot, ()))
        table.add_row(keys.robot_id(robot), str(registers), str(lives[robot]), str(epochs.get(robot, "-")))
    return table


def consequences(done: Restored, out: Path) -> list[str]:
    """What is there now, what is gone, and what a mission makes of it (protocol.md, "Another manager")."""
    said = [f"{out} holds {_commit(done.kept.held)}, of {done.kept.path}"]
    if done.moved_to:
        said.append(f"the damaged store that was there is {done.moved_to} now")
    if done.lost:
        said.append(f"lost: {', '.join(done.lost)}")
    return [
        *said,
        "a manager that starts on it is another life: robots that live notice, and offer all of their registers again",
        "it knows nothing of a revocation after it was backed up: revoke again (orograph revoke)",
    ]


def _commit(held: StoredState) -> str:
    return f"version {held.version} in life {held.manager_epoch} of the manager"
