"""The tables of the map score, from its figures."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from itertools import pairwise
from typing import Any

from orograph.judge.map_obstacles import DISTANCES_M
from rich import box
from rich.table import Table

PLAIN: Mapping[str, Any] = {"box": box.SIMPLE_HEAD, "padding": (0, 1, 0, 0), "title_justify": "left"}
Figures = Mapping[str, Any]
WHAT = {
    "car": "car parks 88 s, leaves", "house": "house built, 88 s later removed", "traffic": "car drives by at 5 m/s",
}  # fmt: skip


def tables(figures: Figures, details: bool) -> Iterator[Table]:
    """The one table of maps, that of changes, and with `details` those behind them."""
    if "maps" in figures:
        yield _summary(figures["maps"])
    if "maps" in figures and details:
        for level, title in (("glrm", "The shared map (GLRM)"), ("hrm", "The robots' fine maps (HRM) at the end")):
            yield _maps(figures["maps"], level, f"{title}, prior>map on the same cells")
        yield _obstacles(figures["maps"])
        for level in ("glrm", "hrm"):
            yield _calibration(figures["maps"], level)
    if "changes" in figures:
        yield _changes(figures["changes"])


def _summary(of: Figures) -> Table:
    heads = ("scenario", "rules", "open\nsure", "ground RMSE\naway [m]", "near walls\n[m]", "seen\n[m]",
             "roofs\nsure/seen", "object MAE\nsure [m]", "seen\n[m]", "IoU\nsure", "\nseen", "houses\ndrivable",
             "vehicles\nmissed", "ghosts\na scan", "HRM\nwrong")  # fmt: skip
    table = Table(*heads, title="The shared map, and what planning sees (prior>map on the same cells)", **PLAIN)
    for scenario, by_rules in of.items():
        first = next(iter(by_rules.values()))["glrm touched prior"]
        near, top, iou, houses = (_number(first[name]) for name in (
            "ground_near_rmse_m", "object_mae_m", "iou", "houses_drivable"))  # fmt: skip
        table.add_row(scenario, "prior", "", "", "", near, "", "", top, "", iou, houses)
        for rules, figures in by_rules.items():
            table.add_row(scenario, rules, *_summary_of(figures))
        table.add_section()
    return table


def _summary_of(figures: Figures) -> Iterator[str]:
    sure, before, touched = figures["glrm confident"], figures["glrm confident prior"], figures["glrm touched"]
    obstacles = figures["obstacles"]
    yield f"{sure['ground_away_cells'] + sure['ground_near_cells']:,.0f}"
    yield from (_step(before, sure, name) for name in ("ground_away_rmse_m", "ground_near_rmse_m"))
    yield _number(touched["ground_near_rmse_m"])
    yield f"{sure['object_cells']:,.0f}/{touched['object_cells']:,.0f}"
    yield _step(before, sure, "object_mae_m")
    yield _number(touched["object_mae_m"])
    yield _step(before, sure, "iou")
    yield from (_number(touched[name]) for name in ("iou", "houses_drivable"))
    yield f"{_number(obstacles['missed'])} ({obstacles['sightings']:.0f})"
    yield _number(obstacles["ghosts_per_scan"])
    yield _number(figures["hrm wrong_though_sure"])


def _maps(of: Figures, level: str, title: str) -> Table:
    table = Table("scenario", "rules", "cells", "open n", "ground RMSE\naway [m]", "near walls [m]", "roofs n",
                  "object height\nMAE [m]", "unknown", "precision", "recall", "IoU", "houses\ndrivable",
                  title=title, **PLAIN)  # fmt: skip
    for scenario, by_rules in of.items():
        for rules, figures in by_rules.items():
            for kind in ("confident", "touched"):
                now, before = figures[f"{level} {kind}"], figures[f"{level} {kind} prior"]
                n = f"{now['ground_away_cells'] + now['ground_near_cells']:,.0f}"
                table.add_row(
                    scenario, rules, kind, n,
                    *(_step(before, now, name) for name in ("ground_away_rmse_m", "ground_near_rmse_m")),
                    f"{now['object_cells']:,.0f}",
                    *(_step(before, now, name) for name in ("object_mae_m",)), _number(now["unknown"]),
                    *(_step(before, now, name) for name in ("precision", "recall", "iou", "houses_drivable")),
                )  # fmt: skip
        table.add_section()
    return table


def _obstacles(of: Figures) -> Table:
    bins = [f"{low:.0f}_{high:.0f}_m" for low, high in pairwise(DISTANCES_M)]
    heads = [f"missed\n{name.replace('_', '-', 1).replace('_', ' ')}" for name in bins]
    table = Table("scenario", "rules", *heads, "ghost cells\na scan",
                  title="Vehicles missed in a scan (sightings), false obstacles within 20 m", **PLAIN)  # fmt: skip
    for scenario, by_rules in of.items():
        for rules, figures in by_rules.items():
            f = figures["obstacles"]
            missed = [f"{_number(f[f'missed_{b}'])} ({f[f'sightings_{b}']:.0f})" for b in bins]
            table.add_row(scenario, rules, *missed, _number(f["ghosts_per_scan"]))
        table.add_section()
    return table


def _calibration(of: Figures, level: str) -> Table:
    kinds = ("away", "near", "roof")
    heads = [f"{name}\nRMSE [m]  wrong  (n)" for name in ("open, away", "open, near walls", "roofs")]
    table = Table("scenario", "rules", "confidence", *heads,
                  title=f"{level.upper()}: error by confidence; wrong = off by more than 0.5 m", **PLAIN)  # fmt: skip
    for scenario, by_rules in of.items():
        for rules, figures in by_rules.items():
            for row in figures[f"{level} calibration"]:
                cells = (f"{_number(row[f'{k}_rmse_m'])}  {_number(row[f'{k}_wrong'])}  ({row[f'{k}_cells']:,.0f})"
                         for k in kinds)  # fmt: skip
                table.add_row(scenario, rules, f"{row['low']:.0f}-{row['high']:.0f}", *cells)
        table.add_section()
    return table


def _changes(of: Figures) -> Table:
    rule_sets = list(next(iter(of.values())))
    heads = [f"{rules}\n{what} [s]" for rules in rule_sets for what in ("found", "cleared")]
    title = "Seconds until planning finds it, and until its place is free again"
    table = Table("change", "robot", *heads, title=title, **PLAIN)
    for course, by_rules in of.items():
        what, robot = course.split()
        cells = [_seconds(by_rules[rules][name]) for rules in rule_sets for name in ("found_s", "cleared_s")]
        table.add_row(WHAT[what], robot, *cells)
    return table


def _step(before: Figures, now: Figures, name: str) -> str:
    return f"{_number(before[name])}>{_number(now[name])}"


def _number(value: float) -> str:
    return "-" if math.isnan(value) else f"{value:.3f}"


def _seconds(value: float | None) -> str:
    return "never" if value is None else "-" if math.isnan(value) else f"{value:.1f}"


def json_ready(value: Any) -> Any:
    """The same to five digits, None for NaN, which JSON does not know."""
    if isinstance(value, dict):
        return {k: json_ready(v) for k, v in value.items()}
    if isinstance(value, list):
        return [json_ready(v) for v in value]
    if isinstance(value, float):
        return float(f"{value:.5g}") if math.isfinite(value) else None
    return value
