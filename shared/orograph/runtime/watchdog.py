"""A process that fails ends, visibly: hooks, a watchdog, signals, and the parent that must not be outlived."""

from __future__ import annotations

import argparse
import faulthandler
import logging
import os
import signal
import sys
import threading
import time
import traceback
from pathlib import Path
from types import TracebackType
from typing import Any, NoReturn

from orograph.runtime import metrics

EXIT_BROKEN = 70
"""EX_SOFTWARE: an exception nobody expected, or a stuck process; the restart policy takes it from here."""
STUCK_S = 90.0
"""Longer than a first start's compiling of kernels on a small machine."""
READY_EVERY_S = 1.0


def options(what: str | None) -> argparse.ArgumentParser:
    """The command line that all services share; `what` is the service's docstring."""
    parser = argparse.ArgumentParser(description=what)
    parser.add_argument("--with-parent", action="store_true", help="end when standard input does")
    parser.add_argument(
        "--ready-file", type=Path, metavar="FILE", help="touched every second while the service is well"
    )
    parser.add_argument(
        "--metrics-port", type=metrics.endpoint, metavar="[ADDRESS:]PORT", help="let Prometheus scrape it there"
    )
    return parser


def whole_number(text: str) -> int | None:
    """An argument that may be left empty, as an unset variable of compose.yaml leaves it; raises ValueError."""
    return int(text) if text else None


def _die(kind: type[BaseException], error: BaseException | None, trace: TracebackType | None) -> None:
    traceback.print_exception(kind, error, trace)
    sys.stderr.flush()
    os._exit(EXIT_BROKEN)


def leave(code: int = 0) -> NoReturn:
    """End now: all is saved and the sessions are closed, and at the interpreter's own farewell zenoh's callback threads
    can hold it for ever.
    """
    sys.stdout.flush()
    sys.stderr.flush()
    os._exit(code)


class Watchdog:
    """Installed once per service process, with its `options`. `stop` is set by SIGTERM and SIGINT."""

    def __init__(self, service: str, arguments: argparse.Namespace) -> None:
        logging.basicConfig(
            level=logging.INFO, stream=sys.stderr, format=f"%(asctime)s {service} %(levelname)s %(message)s"
        )
        faulthandler.enable()
        self.stop = threading.Event()
        self._seen: float | None = None
        self._unseen_s = 0.0
        self._ready_file: Path | None = arguments.ready_file
        self._ready_s = 0.0
        if arguments.metrics_port is not None:
            metrics.serve(*arguments.metrics_port)
        # A live callback subscriber keeps the process after an exception in main: end it for good (zenoh.md 8).
        sys.excepthook = _die
        threading.excepthook = lambda a: _die(a.exc_type, a.exc_value, a.exc_traceback)
        for number in (signal.SIGTERM, signal.SIGINT):
            signal.signal(number, self._on_signal)
        if arguments.with_parent:
            threading.Thread(target=self._follow_parent, daemon=True).start()
        threading.Thread(target=self._watch, daemon=True).start()

    def alive(self, ready: bool = True) -> None:
        """Call once a turn of the main loop; the watchdog begins with the first call.

        `ready`: the service does its work, or could at once (a spare), so that its container counts as healthy.
        """
        self._seen, self._unseen_s = time.monotonic(), 0.0
        if ready and self._seen - self._ready_s >= READY_EVERY_S:
            self._show_ready()

    def busy(self) -> None:
        """What follows may take longer than the watchdog's patience; it sleeps until the next `alive()`.

        Who was ready stays so.
        """
        self._seen = None

    def _show_ready(self) -> None:
        self._ready_s = time.monotonic()
        if self._ready_file is not None:
            self._ready_file.touch()

    def _on_signal(self, number: int, frame: Any) -> None:
        self.stop.set()

    def _follow_parent(self) -> None:
        """The runner holds our standard input open: its end is the runner's death."""
        while os.read(0, 1):  # unbuffered: a daemon thread must not hold a stream's lock at interpreter shutdown
            continue
        self.stop.set()
        time.sleep(5)
        os._exit(EXIT_BROKEN)

    def _watch(self) -> None:
        while True:
            time.sleep(READY_EVERY_S)
            # Counted in this thread's own turns, not by a clock: a container that was paused is not stuck.
            self._unseen_s = 0.0 if self._seen is None else self._unseen_s + READY_EVERY_S
            if self._seen is None and self._ready_s > 0.0:
                self._show_ready()
            if self._unseen_s > STUCK_S:
                faulthandler.dump_traceback()
                os._exit(EXIT_BROKEN)
