"""What Zenoh's threads call: an exception there ends nothing, and is never swallowed (zenoh.md, 16)."""

from __future__ import annotations

import logging
import threading
import traceback
from collections import Counter
from collections.abc import Callable
from typing import Any

log = logging.getLogger("orograph")


class Callbacks:
    """Counts by kind what callbacks raise, and says the first of each kind."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._errors: Counter[str] = Counter()

    def guarded(self, kind: str, callback: Callable[[Any], None]) -> Callable[[Any], None]:
        """The same callback for Zenoh; `kind` is one of `keys.CALLBACKS`."""

        def call(heard: Any) -> None:
            try:
                callback(heard)
            except Exception as error:
                self._count(kind, error)

        return call

    def figures(self) -> dict[str, int]:
        """`callback_errors_<kind>` of what was raised so far."""
        with self._lock:
            return {f"callback_errors_{kind}": n for kind, n in self._errors.items()}

    def _count(self, kind: str, error: Exception) -> None:
        with self._lock:
            self._errors[kind] += 1
            first = self._errors[kind] == 1
        if first:
            place = traceback.extract_tb(error.__traceback__)[-1]
            what = f"{type(error).__name__}: {error} ({place.filename.rpartition('/')[2]}:{place.lineno})"
            log.error("%s could not be taken, more of this kind are only counted: %s", kind, what)
