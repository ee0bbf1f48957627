"""`router-sim`, `router-radio`: a Zenoh router in a process of its own."""

from __future__ import annotations

import argparse
import sys

from orograph.edge.guard import Guard
from orograph.edge.session import open_router


def main() -> int:
    """Route until told to stop."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--listen", required=True, metavar="ENDPOINT")
    parser.add_argument("--peer", action="append", default=[], metavar="ENDPOINT")
    parser.add_argument("--with-parent", action="store_true")
    options = parser.parse_args()
    guard = Guard("router", options.with_parent)
    try:
        router = open_router(options.listen, tuple(options.peer))
    except OSError as error:
        print(f"router: {error}", file=sys.stderr)
        return 1
    with router:
        while not guard.stop.wait(1.0):
            guard.alive()
    return 0


if __name__ == "__main__":
    sys.exit(main())
