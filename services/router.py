"""`router-sim`, `router-radio`: a Zenoh router in a process of its own."""

from __future__ import annotations

import sys

from orograph.comms.session import open_router
from orograph.runtime import metrics
from orograph.runtime.watchdog import Watchdog, leave, options


def main() -> int:
    """Route until told to stop."""
    parser = options(__doc__)
    parser.add_argument("--listen", required=True, metavar="ENDPOINT")
    parser.add_argument("--peer", action="append", default=[], metavar="ENDPOINT")
    arguments = parser.parse_args()
    watchdog = Watchdog("router", arguments)
    try:
        router = open_router(arguments.listen, tuple(arguments.peer))
    except OSError as error:
        print(f"router: {error}", file=sys.stderr)
        return 1
    with router:
        watchdog.alive()
        while not watchdog.stop.wait(1.0):
            watchdog.alive()
            metrics.FIGURES.show({"router": {"transports": len(router.info.transports())}}, {})
    return 0


if __name__ == "__main__":
    leave(main())
