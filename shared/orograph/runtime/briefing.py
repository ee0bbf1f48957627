"""What runs, asked over the sim plane: services share neither a folder nor an environment to know it."""

from __future__ import annotations

import logging
import time
import zlib
from dataclasses import dataclass
from pathlib import Path

from orograph import keys
from orograph.comms.bus import Bus
from orograph.control import CurrentRun
from orograph.runtime.watchdog import Watchdog
from orograph.scenario import JSON_MAX_BYTES, Scenario

ASK_EVERY_S = 0.3

log = logging.getLogger("orograph")


@dataclass(frozen=True)
class Briefing:
    """A run: its resolved scenario, and its name, that of its folder in run_dir (".": run_dir itself)."""

    scenario: Scenario
    run_dir: Path
    run: str = "."

    @property
    def folder(self) -> Path:
        """This process's folder of the run."""
        return self.run_dir / self.run


def answer(bus: Bus, briefing: Briefing) -> None:
    """Tell whoever asks, as long as the bus is open."""
    told = CurrentRun(briefing.run, zlib.compress(briefing.scenario.model_dump_json().encode()))
    bus.answer(keys.BRIEFING, lambda: told)


def ask(bus: Bus, run_dir: Path, timeout_s: float = 2.0) -> Briefing | None:
    """What runs, None where nobody knows yet."""
    told = bus.ask(keys.BRIEFING, None, CurrentRun, timeout_s)
    if told is None:
        return None
    text = zlib.decompressobj().decompress(told.scenario, JSON_MAX_BYTES)
    return Briefing(Scenario.model_validate_json(text), run_dir, told.run)


def await_briefing(bus: Bus, run_dir: Path, watchdog: Watchdog) -> Briefing | None:
    """Ask until somebody knows, saying so once; None when told to stop."""
    said = False
    while not watchdog.stop.is_set():
        watchdog.alive(ready=False)
        if (briefing := ask(bus, run_dir)) is not None:
            return briefing
        if not said:
            log.info("waiting for the orchestrator to say what runs")
        said = True
        watchdog.stop.wait(ASK_EVERY_S)
    return None


def running(bus: Bus, run_dir: Path, watchdog: Watchdog, within_s: float) -> Briefing | None:
    """The run that a living world knows of, None where none answers in time: an orchestrator that starts asks first."""
    deadline_s = time.monotonic() + within_s
    while (briefing := ask(bus, run_dir)) is None and time.monotonic() < deadline_s:
        watchdog.stop.wait(ASK_EVERY_S)
    return briefing
