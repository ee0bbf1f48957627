"""`router-sim`, `router-radio`: a Zenoh router in a process of its own."""

from __future__ import annotations

import sys

from orograph.edge import metrics
from orograph.edge.guard import Guard, leave, options
from orograph.edge.session import open_router


def main() -> int:
    """Route until told to stop."""
    parser = options(__doc__)
    parser.add_argument("--listen", required=True, metavar="ENDPOINT")
    parser.add_argument("--peer", action="append", default=[], metavar="ENDPOINT")
    arguments = parser.parse_args()
    guard = Guard("router", arguments)
    try:
        router = open_router(arguments.listen, tuple(arguments.peer))
    except OSError as error:
        print(f"router: {error}", file=sys.stderr)
        return 1
    with router:
        guard.alive()
        while not guard.stop.wait(1.0):
            guard.alive()
            metrics.FIGURES.show({"router": {"transports": len(router.info.transports())}}, {})
    return 0


if __name__ == "__main__":
    leave(main())
