"""Pictures of quantities: coverage and backlog over time, error by confidence, pose error, the run's events."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from orograph.arrays import F64
from orograph.judge.score import CONFIDENCE_BINS, SHARES
from orograph.report import palette
from orograph.report.palette import Picture
from orograph.storage.results import Scores

Series = Mapping[str, tuple[F64, F64]]
"""Robot -> (time [s], value)."""
Silences = Sequence[tuple[float, float]]
"""Stretches [begin, end] without radio [s]."""


def coverage(
    time_s: F64, share: F64, reached_s: Mapping[int, float | None], radio_down: Mapping[str, Silences], backlog: Series,
    end_s: float, flush_s: float | None,
) -> Picture:  # fmt: skip
    """Coverage (0..1) over time with its milestones; below it each robot's backlog [cells] and radio silence."""
    robots = list(dict.fromkeys([*radio_down, *backlog]))

    def draw(figure: Figure) -> None:
        upper, lower = figure.subplots(2, 1, sharex=True, height_ratios=[1.6, 1.0])
        _coverage(upper, time_s, share, reached_s)
        if flush_s is not None:
            upper.axvline(flush_s, color=palette.QUIET, lw=0.8, ls=(0, (1, 2)))
            upper.annotate("flush", (flush_s, 2), (-4, 0), textcoords="offset points", ha="right", fontsize=8)
        for i, robot in enumerate(robots):
            _backlog(lower, i, backlog.get(robot), radio_down.get(robot, ()))
        lower.set_xlim(0, max(end_s, 1.0))
        lower.set_ylim(bottom=0)
        lower.set_xlabel("simulation time [s]")
        lower.set_ylabel("cells waiting" if backlog else "no radio")
        if not backlog:
            lower.set_yticks([])
        names = [Line2D([], [], color=palette.robot_colour(i), lw=2.5, label=r) for i, r in enumerate(robots)]
        lower.legend(handles=names, loc="upper left", bbox_to_anchor=(1.0, 1.0), fontsize=8)

    return palette.picture(
        (10.0, 5.2),
        "Above: share of the cells observable from the patrol that had reached confidence 64 in the global map. "
        "Below: bands mark the time without radio, lines the cells a robot holds that the map manager has not "
        "acknowledged yet. "
        "A robot in a shadow piles up, then empties within seconds of its return.",
        "Line chart of coverage rising over simulation time, and of each robot's backlog of unsent cells.",
        draw,
    )


def _coverage(axes: Axes, time_s: F64, share: F64, reached_s: Mapping[int, float | None]) -> None:
    axes.fill_between(time_s, 100 * share, color=palette.ROBOT_COLOURS[0], alpha=0.12, lw=0, step="post")
    axes.step(time_s, 100 * share, color=palette.ROBOT_COLOURS[0], lw=1.8, where="post")
    for level in SHARES:
        at = reached_s.get(level)
        axes.axhline(level, color=palette.RULE, lw=0.6, zorder=0)
        if at is not None:
            axes.plot(at, level, "o", ms=4.5, color=palette.INK)
    reached = [f"{level} % at {at:.0f} s" for level, at in reached_s.items() if at is not None]
    axes.set_title(" · ".join(reached) or "50 % was not reached", fontsize=9, fontweight="normal")
    axes.set_ylim(0, 104)
    axes.set_ylabel("coverage [%]")


def _backlog(axes: Axes, i: int, series: tuple[F64, F64] | None, silent: Silences) -> None:
    colour = palette.robot_colour(i)
    for begin, end in silent:
        axes.axvspan(begin, end, color=colour, alpha=0.13, lw=0)
    if series is not None:
        axes.step(*series, color=colour, lw=1.3, where="post")


def error_by_confidence(scores: Mapping[str, Scores]) -> Picture:
    """Height RMSE in each confidence bin, per map ('GLRM', 'HRM'), against both truths."""

    def draw(figure: Figure) -> None:
        all_axes = figure.subplots(1, len(scores), squeeze=False)[0]
        for axes, (title, pair) in zip(all_axes, scores.items(), strict=True):
            _bin_bars(axes, pair)
            axes.set_title(title)
        all_axes[0].set_ylabel("height RMSE [m]")
        all_axes[0].legend(fontsize=8)

    return palette.picture(
        (10.0, 3.4),
        "Does confidence mean anything? Root mean square of the height error [m] by the map's own confidence; the "
        "count above each bar is "
        "the number of cells. Below 64 a cell is mostly prior.",
        "Bar charts of height error by confidence bin for the global and the local maps.",
        draw,
    )


def _bin_bars(axes: Axes, scores: Scores) -> None:
    labels = [f"{low}–{high - 1}" for low, high in CONFIDENCE_BINS]
    names = ("true surface", "same rules, ideal scans")
    pair = (scores.surface, scores.ideal)
    for i, (score, name, colour) in enumerate(zip(pair, names, palette.ROBOT_COLOURS, strict=False)):
        heights = [e.rmse_m if e.cells else 0.0 for e in score.by_confidence]
        bars = axes.bar(np.arange(len(labels)) + (i - 0.5) * 0.36, heights, 0.33, color=colour, label=name)
        counts = [f"{e.cells:,}" if e.cells else "none" for e in score.by_confidence]
        axes.bar_label(bars, counts, fontsize=7, color=palette.QUIET, padding=2)
    axes.set_xticks(range(len(labels)), labels)
    axes.set_xlabel("confidence")


def pose_errors(errors_m: Series, end_s: float) -> Picture:
    """Distance between estimated and true position over time, per robot."""

    def draw(figure: Figure) -> None:
        axes = figure.subplots()
        for i, (robot, (time_s, error)) in enumerate(errors_m.items()):
            axes.plot(time_s, 100 * error, color=palette.robot_colour(i), lw=1.1, label=robot)
        axes.set_xlim(0, max(end_s, 1.0))
        axes.set_ylim(bottom=0)
        axes.set_xlabel("simulation time [s]")
        axes.set_ylabel("position error [cm]")
        axes.legend(loc="upper left", bbox_to_anchor=(1.0, 1.0), fontsize=8)

    return palette.picture(
        (10.0, 2.9),
        "How well each robot knew where it was: distance between its estimate and the truth, in the plane [cm]. Map "
        "heights are "
        "placed by this estimate. Humps are stretches of poor satellite reception.",
        "Line chart of position error in centimetres over simulation time, one line per robot.",
        draw,
    )


def timeline(events: Sequence[Mapping[str, Any]], lanes: Sequence[str], end_s: float) -> Picture:
    """Noted events over time, a lane per robot or service."""
    kinds = list(dict.fromkeys(str(e.get("event", "?")) for e in events))
    marks = "osD^vP*X<>d"

    def draw(figure: Figure) -> None:
        axes = figure.subplots()
        for k, kind in enumerate(kinds):
            here = [e for e in events if e.get("event", "?") == kind]
            x = [int(e.get("stamp_ns", 0)) / 1e9 for e in here]
            y = [lanes.index(lane_of(e)) for e in here]
            colour = palette.ALARM if kind in TROUBLE else palette.ROBOT_COLOURS[k % len(palette.ROBOT_COLOURS)]
            axes.plot(x, y, marks[k % len(marks)], ms=5.5, color=colour, alpha=0.85, label=kind, mec="#ffffff", mew=0.4)
        axes.set_yticks(range(len(lanes)), lanes)
        axes.set_ylim(len(lanes) - 0.5, -0.5)
        axes.set_xlim(-0.01 * end_s, 1.01 * end_s)
        axes.grid(axis="y", color=palette.RULE, lw=0.6)
        axes.set_xlabel("simulation time [s]")
        axes.legend(loc="upper left", bbox_to_anchor=(1.0, 1.05), fontsize=8, ncols=1 + len(kinds) // 12)

    return palette.picture(
        (10.0, 1.3 + 0.42 * len(lanes)),
        "What the services had to say, in order: missions, hand-overs, troubles. Red marks are troubles.",
        "Timeline of events, a lane for each robot and service.",
        draw,
    )


TROUBLE = frozenset((
    "stuck", "gave-up", "wheels-spin", "contact", "robot-tipped", "fenced", "store-full", "rejected", "robot-lost",
    "died", "restarted", "killed", "fault",
))  # fmt: skip
"""Kinds of events that a reader should look at."""


def lane_of(event: Mapping[str, Any]) -> str:
    """The robot an event is about, else the service that noted it."""
    robot, service = event.get("robot"), event.get("service")
    return str(robot if isinstance(robot, str) and robot else service or "run")
