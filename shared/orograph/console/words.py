"""What the page says in words: the state of the run, the robots, events, a scale's legend, one cell."""

from __future__ import annotations

from html import escape

import numpy as np

from orograph.arrays import I64
from orograph.console.colours import WHO, Look, Scale
from orograph.console.film import RADIO, Film
from orograph.grid import Grid
from orograph.keys import robot_id
from orograph.layers import CONFIDENT, KINDS, CellMap
from orograph.protocol.explained import PRIOR, Explanation, Step
from orograph.report.palette import robot_colour

EVENTS_SHOWN = 9
LEGEND_STEPS = 12
UNKNOWN = "unknown"
BOX = "padding:0 0.8em 0.4em;font-size:12px;line-height:1.45"
QUIET = "opacity:0.65"
NO_CELL = f"<div style='{BOX}'>Click the map: its cell tells its layers here. Ctrl-click: fly there.</div>"


def clock(stamp_ns: int) -> str:
    """Minutes and seconds of simulation."""
    seconds = stamp_ns / 1e9
    return f"{int(seconds) // 60}:{seconds % 60:04.1f}"


def headline(film: Film, look: Look, stamp_ns: int, pace: float) -> str:
    """How far the map is, and each robot's state, as HTML; `pace` is simulation over real time."""
    share = float((np.isfinite(look.age_s) & (look.confidence >= CONFIDENT)).mean())
    rows = "".join(_robot_row(film, robot, i, stamp_ns) for i, robot in enumerate(film.robots))
    state = f"live, x{pace:.1f} real time" if film.live else f"of {clock(film.end_ns)}"
    return (
        f"<div style='{BOX}'><div style='font-size:20px;font-weight:600'>{clock(stamp_ns)} "
        f"<span style='font-size:12px;font-weight:400;{QUIET}'>min of simulation, {state}</span></div>"
        f"<div>mapped {share:.1%} of the area</div>"
        f"<div style='height:5px;background:rgba(128,128,128,.3);border-radius:3px;margin:2px 0 6px'>"
        f"<div style='height:5px;width:{share:.1%};background:#2a9d8f;border-radius:3px'></div></div>"
        f"<table style='width:100%;border-spacing:0'>{rows}</table></div>"
    )


def _robot_row(film: Film, robot: str, index: int, stamp_ns: int) -> str:
    pose, waiting = film.pose(robot, stamp_ns), film.waiting(robot, stamp_ns)
    dot = f"<span style='color:{robot_colour(index)};font-size:15px'>&#9679;</span>"
    radio = "not there yet" if pose is None else "radio up" if pose[RADIO] else "<b>no radio</b>"
    return (
        f"<tr><td>{dot} {escape(robot)}</td><td>{radio}</td>"
        f"<td style='text-align:right'>{f'{waiting} waiting' if waiting else f'<span style={QUIET!r}>all home</span>'}"
        "</td></tr>"
    )


def legend(scale: Scale, look: Look) -> str:
    """A scale's bar with its ends, as HTML."""
    low, high = scale.limits(look)
    stops = np.asarray(scale.colours(np.linspace(0, 1, LEGEND_STEPS)))[:, :3]
    bar = ",".join("#" + "".join(f"{round(v * 255):02x}" for v in rgb) for rgb in stops)
    if scale.needs == WHO:
        return f"<div style='{BOX}'><div style='{QUIET}'>{escape(scale.says)}</div></div>"
    ends = [f"{value:+g}" if low < 0 and value else f"{value:.3g}" for value in (low, (low + high) / 2, high)]
    return (
        f"<div style='{BOX}'><div style='height:10px;border-radius:3px;background:linear-gradient(90deg,{bar})'></div>"
        f"<div style='display:flex;justify-content:space-between'><span>{ends[0]}</span><span>{ends[1]}</span>"
        f"<span>{ends[2]} {scale.unit}</span></div><div style='{QUIET}'>{escape(scale.says)}</div></div>"
    )


def events(film: Film, stamp_ns: int) -> str:
    """The newest events, newest first, as HTML."""
    lines = [
        f"<div><span style='{QUIET}'>{clock(int(e['stamp_ns']))}</span> {escape(_told(e))}</div>"
        for e in film.past(stamp_ns)[: -EVENTS_SHOWN - 1 : -1]
    ]
    return f"<div style='{BOX};height:{EVENTS_SHOWN * 1.45:.1f}em;overflow:hidden'>{''.join(lines)}</div>"


def _told(event: object) -> str:
    assert isinstance(event, dict)
    who = event.get("robot") or event.get("service") or ""
    known = {"stamp_ns", "service", "robot", "event", "x_m", "y_m"}
    rest = ", ".join(f"{k} {v}" for k, v in event.items() if k not in known)
    return f"{who}: {event.get('event', '?')}{f' ({rest})' if rest else ''}"


def cell(grid: Grid, row: int, col: int, cells: CellMap, look: Look, changed_ns: I64) -> str:
    """One cell with all its layers, as HTML."""
    x, y = grid.centre_m(row, col)
    changed = int(changed_ns[row * grid.cols + col])
    lines = [(name, _value(float(layer[row, col])), _short(KINDS[name].unit)) for name, layer in cells.layers()]
    lines += [
        ("surface, as believed at first", _value(float(look.prior_m[row, col])), "m"),
        ("surface, in truth", _value(float(look.truth_m[row, col])), "m"),
        ("changed last", "never, this is the prior" if changed < 0 else clock(changed), ""),
    ]
    table = "".join(
        f"<tr><td style='{QUIET}'>{escape(name)}</td>"
        f"<td>{escape(value)} {escape('' if value == UNKNOWN else unit)}</td></tr>"
        for name, value, unit in lines
    )
    return (
        f"<div style='{BOX}'><b>cell {row}, {col}</b> at {x:g}, {y:g} m"
        f"<table style='width:100%;line-height:1.3'>{table}</table></div>"
    )


def explained(film: Film, found: Explanation) -> str:
    """Whose registers made a cell in the end, and what the fold decided on each, as HTML."""
    lines = "".join(f"<div>{_step(step)}</div>" for step in found.steps)
    when = "now" if film.live else "at the end"
    return f"<div style='{BOX};border-top:1px solid rgba(128,128,128,.4)'><b>how it came about</b>, {when}{lines}</div>"


def _step(step: Step) -> str:
    if step.robot == PRIOR:
        return f"<span style='{QUIET}'>prior:</span> {escape(step.decided)}"
    index = step.robot - 1
    return (
        f"<span style='color:{robot_colour(index)}'>&#9679;</span> {robot_id(step.robot)} "
        f"<span style='{QUIET}'>{clock(step.tick_ms * 1_000_000)}, counts {step.weight:.0f}:</span> "
        f"{escape(step.decided)}"
    )


def _short(unit: str) -> str:
    """A unit; a range of values is none."""
    return unit if unit.startswith("m") else ""


def _value(value: float) -> str:
    return UNKNOWN if np.isnan(value) else f"{value:.3g}" if abs(value) < 100 else f"{value:.1f}"
