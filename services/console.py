"""`console`: a page on which the run is seen, live; hears and asks what runs, sends nothing else."""

from __future__ import annotations

import sys
from contextlib import suppress

from orograph.comms.bus import Bus
from orograph.comms.observer import Observer
from orograph.console.live import KINDS, LiveFilm
from orograph.console.page import PORT, Page, open_server
from orograph.errors import InputError
from orograph.runtime.briefing import await_briefing
from orograph.runtime.participant import EXIT_RELEASED
from orograph.runtime.settings import Settings
from orograph.runtime.watchdog import Watchdog, leave, options
from orograph.storage.copied_state import copied_state


def main() -> int:
    """Run the service until it is told to stop."""
    parser = options(__doc__)
    parser.add_argument("--host", default="127.0.0.1", help="address of the page (default: %(default)s)")
    parser.add_argument("--port", type=int, default=PORT, help="port of the page (default: %(default)s)")
    arguments = parser.parse_args()
    watchdog, settings = Watchdog("console", arguments), Settings.from_environment()
    try:
        server = open_server(arguments.host, arguments.port)
    except InputError as error:
        print(f"console: {error}", file=sys.stderr)
        return 2
    with suppress(InterruptedError), Bus.open(settings.sim, settings.radio, watchdog.stop) as bus:
        briefing = await_briefing(bus, settings.run_dir, watchdog)
        if briefing is not None:
            live = LiveFilm(briefing)
            live.catch_up(copied_state(briefing.folder, briefing.scenario.grid.grid.shape))
            Observer(bus.sessions, KINDS, live.hear)

            def turn() -> None:
                watchdog.alive()
                if live.begun_anew:
                    watchdog.stop.set()

            Page(server, live.film).run(watchdog.stop, turn)
            return EXIT_RELEASED if live.begun_anew else 0
    return 0


if __name__ == "__main__":
    leave(main())
