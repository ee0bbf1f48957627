"""A process that fails ends, visibly: hooks, a watchdog, signals, and the parent that must not be outlived."""

from __future__ import annotations

import faulthandler
import logging
import os
import signal
import sys
import threading
import time
import traceback
from types import TracebackType
from typing import Any

EXIT_BROKEN = 70
"""EX_SOFTWARE: an exception nobody expected, or a stuck process; the restart policy takes it from here."""
STUCK_S = 30.0


def _die(kind: type[BaseException], error: BaseException | None, trace: TracebackType | None) -> None:
    traceback.print_exception(kind, error, trace)
    sys.stderr.flush()
    os._exit(EXIT_BROKEN)


class Guard:
    """Installed once per service process. `stop` is set by SIGTERM and SIGINT; call `alive()` once a frame."""

    def __init__(self, service: str, with_parent: bool) -> None:
        logging.basicConfig(
            level=logging.INFO, stream=sys.stderr, format=f"%(asctime)s {service} %(levelname)s %(message)s"
        )
        faulthandler.enable()
        self.stop = threading.Event()
        self._seen: float | None = None
        # A live callback subscriber keeps the process after an exception in main: end it for good (zenoh.md 8).
        sys.excepthook = _die
        threading.excepthook = lambda a: _die(a.exc_type, a.exc_value, a.exc_traceback)
        for number in (signal.SIGTERM, signal.SIGINT):
            signal.signal(number, self._on_signal)
        if with_parent:
            threading.Thread(target=self._follow_parent, daemon=True).start()
        threading.Thread(target=self._watch, daemon=True).start()

    def alive(self) -> None:
        """Say that the main loop turns; the watchdog begins with the first call."""
        self._seen = time.monotonic()

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
            time.sleep(1.0)
            if self._seen is not None and time.monotonic() - self._seen > STUCK_S:
                faulthandler.dump_traceback()
                os._exit(EXIT_BROKEN)
