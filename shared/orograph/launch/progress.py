"""What a run tells those who watch it."""

from __future__ import annotations

from collections.abc import Callable

Figures = dict[str, dict[str, float]]
"""Newest telemetry by node name."""
OnProgress = Callable[[Figures, list[str]], None]
"""Called with the newest figures and the restarts so far."""


def unseen(figures: Figures, restarts: list[str]) -> None:
    """Nobody watches."""
