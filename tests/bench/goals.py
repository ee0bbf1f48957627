"""The table that both benches print: what was measured, beside its goal."""

from __future__ import annotations

from collections.abc import Mapping

from rich.table import Table

Goal = tuple[str, float, str]
"""(`<=` or `>=`, goal, what is measured)."""


def table(goals: Mapping[str, Goal], figures: Mapping[str, float]) -> Table:
    """A row for each goal."""
    out = Table("figure", "measured", "goal", "", "what")
    for name, (sense, goal, what) in goals.items():
        met = figures[name] <= goal if sense == "<=" else figures[name] >= goal
        out.add_row(name, f"{figures[name]:,.4g}", f"{sense} {goal:,.4g}", "met" if met else "MISSED", what)
    return out
