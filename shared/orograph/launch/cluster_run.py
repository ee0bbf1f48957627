"""A run of the cluster: the one that goes on, or a new one in the folder of runs; and its report when it has ended."""

from __future__ import annotations

import logging
import time
from pathlib import Path

from orograph.comms.bus import Bus
from orograph.errors import InputError, RunError
from orograph.launch.lifecycle import finish, prepare_out
from orograph.runtime.briefing import Briefing, running
from orograph.runtime.watchdog import Watchdog
from orograph.scenario import Scenario
from orograph.storage.run_folder import LATEST, REPORT, SCHEMA, WORLD, next_folder, write_whole

SCHEMA_VERSION = "1"
LEARN_S = 1.0
"""An orchestrator that starts in the middle of a run hears of it from the world within this time."""
RESULT_S = 20.0
POLL_S = 0.2

log = logging.getLogger("orograph")


class ClusterRun:
    """`run` names the run where somebody else keeps its folder and reports on it.

    Raises InputError for a folder of runs that is not ours.
    """

    def __init__(self, scenario: Scenario, run_dir: Path, run: str | None) -> None:
        self._scenario, self._run_dir, self._run = scenario, run_dir, run
        self._briefing: Briefing | None = None
        if run is None:
            _check_schema(run_dir)

    def begin(self, bus: Bus, watchdog: Watchdog) -> Briefing:
        """The run to take part in; raises InputError where there can be none."""
        if self._run is not None:
            return Briefing(self._scenario, self._run_dir, self._run)
        self._briefing = running(bus, self._run_dir, watchdog, LEARN_S) or self._new()
        log.info("run %s of %s", self._briefing.run, self._briefing.scenario.name)
        return self._briefing

    def _new(self) -> Briefing:
        out = prepare_out(next_folder(self._run_dir, self._scenario.name), self._scenario)
        write_whole(self._run_dir / LATEST, out.name + "\n")
        return Briefing(self._scenario, self._run_dir, out.name)

    def report(self, watchdog: Watchdog) -> None:
        """Wait for what the world leaves and compose the finished run folder, unless told to stop."""
        if self._briefing is None or watchdog.stop.is_set():
            return
        watchdog.busy()
        result, deadline_s = self._briefing.folder / WORLD, time.monotonic() + RESULT_S
        while not result.exists() and time.monotonic() < deadline_s and not watchdog.stop.is_set():
            watchdog.stop.wait(POLL_S)
        try:
            finish(self._briefing.scenario, self._briefing.folder, "containers")
            log.info("report: %s", self._briefing.folder / REPORT)
        except RunError as error:  # started again, this process would begin another run
            log.error("%s", error)


def _check_schema(run_dir: Path) -> None:
    """Mark a new folder of runs as ours; raises InputError for one of another program version."""
    mark = run_dir / SCHEMA
    try:
        found = mark.read_text().strip() if mark.exists() else "none" if any(run_dir.iterdir()) else SCHEMA_VERSION
        if found == SCHEMA_VERSION:
            write_whole(mark, SCHEMA_VERSION + "\n")
    except OSError as error:
        raise InputError(f"{run_dir}: cannot be used for runs ({error.strerror})") from None
    if found != SCHEMA_VERSION:
        raise InputError(
            f"{run_dir}: its schema is {found}, this program writes {SCHEMA_VERSION}; nothing was changed: "
            "copy the runs out (make fetch-run), then name another volume or remove this one"
        )
