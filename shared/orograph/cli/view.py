"""`orograph view`: a finished run in a browser, with a slider over its time."""

from __future__ import annotations

import argparse
import threading
from pathlib import Path

from orograph.launch.processes import free_port


def add_parser(subparsers: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Declare the command's options."""
    parser = subparsers.add_parser(
        "view", help="see a finished run again in a browser",
        description="Show a finished run on a page of this machine: its map as it grew, its robots, its events.",
    )  # fmt: skip
    parser.add_argument("folder", type=Path, help="run folder, as `orograph run` leaves it")
    parser.add_argument("--port", type=int, default=0, metavar="PORT", help="of the page on 127.0.0.1 (default: free)")
    parser.set_defaults(main=main)


def main(args: argparse.Namespace) -> int:
    """Serve the page until Ctrl-C; raises InputError for a folder without a run, or a port that is taken."""
    from orograph.console.page import Page, open_server  # heavy: only once there is something to show
    from orograph.console.played import played

    port = free_port(args.port)
    film = played(args.folder)
    page = Page(open_server("127.0.0.1", port), lambda: film)
    print(f"{film.title}: {page.url}   (Ctrl-C ends it)", flush=True)
    page.run(threading.Event())
    return 0
