"""Waiting for what another process or thread does: polled, never slept for, and bounded."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any


def until(condition: Callable[[], Any], what: str, within_s: float = 20.0, poll_s: float = 0.01) -> Any:
    """What the condition gives once it holds; the test fails, naming what never came."""
    deadline_s = time.monotonic() + within_s
    while not (found := condition()):
        assert time.monotonic() < deadline_s, what
        time.sleep(poll_s)
    return found
