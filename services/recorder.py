"""`recorder`: the run as one MCAP file in its folder; hears and asks what runs, sends nothing else."""

from __future__ import annotations

import logging
from contextlib import suppress

from orograph.comms.bus import Bus
from orograph.comms.observer import Observer
from orograph.launch.machine import commit
from orograph.record.recorder import KINDS, Recorder
from orograph.runtime.briefing import await_briefing
from orograph.runtime.settings import Settings
from orograph.runtime.watchdog import Watchdog, leave, options
from orograph.scene.site import Site

TURN_S = 0.2


def main() -> int:
    """Run the service until it is told to stop."""
    parser = options(__doc__)
    parser.add_argument("--full-scans", action="store_true", help="every scan, and all of it")
    arguments = parser.parse_args()
    watchdog, settings = Watchdog("recorder", arguments), Settings.from_environment()
    with suppress(InterruptedError), Bus.open(settings.sim, settings.radio, watchdog.stop) as bus:
        briefing = await_briefing(bus, settings.run_dir, watchdog)
        if briefing is None:
            return 0
        told = {"commit": commit(), "run": briefing.run}
        with Recorder(Site(briefing.scenario), briefing.folder, told, arguments.full_scans) as recorder:
            observer = Observer(bus.sessions, KINDS, recorder.hear)
            while not watchdog.stop.is_set():
                watchdog.alive()
                recorder.write(TURN_S)
        refused = observer.callbacks.figures()
        logging.getLogger("orograph").info(
            "%s: %d not written, refused: %s", recorder.path, recorder.dropped, refused or "none"
        )
    return 0


if __name__ == "__main__":
    leave(main())
