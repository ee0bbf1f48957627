"""Pictures of layers seen from above: occupation, confidence, error, and the robots' paths with their radio."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from orograph.arrays import F64, Mask
from orograph.grid import Grid
from orograph.layers import CONFIDENT, CellMap, Layer
from orograph.report import palette
from orograph.report.palette import Picture
from orograph.storage.results import SurfaceChange

Path = F64
UNCHANGED_M = 0.002
"""What the wire's millimetres round away is no change."""


def shown_extent(grid: Grid, interesting: Mask, margin_m: float = 25.0) -> tuple[float, ...]:
    """x_min, x_max, y_min, y_max of the interesting cells with a margin, within the grid; the whole grid if none is."""
    x0, y0, x1, y1 = grid.extent_m
    rows, cols = np.nonzero(interesting)
    if not rows.size:
        return x0, x1, y0, y1
    left, right = x0 + cols.min() * grid.cell_m, x0 + (cols.max() + 1) * grid.cell_m
    low, high = y0 + rows.min() * grid.cell_m, y0 + (rows.max() + 1) * grid.cell_m
    return max(x0, left - margin_m), min(x1, right + margin_m), max(y0, low - margin_m), min(y1, high + margin_m)


def window_of(grid: Grid, extent: tuple[float, ...]) -> tuple[Grid, tuple[slice, slice]]:
    """A grid's cells within an extent on it (x_min, x_max, y_min, y_max): as a grid, and as slices of its layers."""
    cell = grid.cell_m
    left, right = (round((x - grid.origin_m[0]) / cell) for x in extent[:2])
    low, high = (round((y - grid.origin_m[1]) / cell) for y in extent[2:])
    return grid.window(low, left, (high - low, right - left)), (slice(low, high), slice(left, right))


def draw_layer(axes: Axes, grid: Grid, layer: npt.NDArray[Any], norm: Normalize, colours: Any) -> ScalarMappable:
    """One layer as cells, unknown in grey; gives the mappable for its colour bar."""
    x0, y0, x1, y1 = grid.extent_m
    axes.set_facecolor(palette.UNKNOWN)
    axes.set_aspect("equal")
    axes.set_xlabel("x east [m]")
    axes.set_ylabel("y north [m]")
    return axes.imshow(
        np.ma.masked_invalid(layer), extent=(x0, x1, y0, y1), origin="lower", norm=norm, cmap=colours,
        interpolation="none", rasterized=True,
    )  # fmt: skip


def zoom(axes: Axes, extent: tuple[float, ...]) -> None:
    """Show no more than (x_min, x_max, y_min, y_max) [m]."""
    axes.set_xlim(extent[0], extent[1])
    axes.set_ylim(extent[2], extent[3])


def add_bar(figure: Figure, axes: Axes, mappable: ScalarMappable, label: str) -> None:
    """A colour bar beside a layer."""
    bar = figure.colorbar(mappable, ax=axes, shrink=0.7, pad=0.02, aspect=28)
    bar.set_label(label)
    bar.outline.set_linewidth(0.4)


def occupation_and_confidence(glrm: CellMap, extent: tuple[float, ...]) -> Picture:
    """The two layers of the final GLRM that planning and scoring rest on, side by side."""

    def draw(figure: Figure) -> None:
        left, right = figure.subplots(1, 2)
        shown = draw_layer(left, glrm.grid, glrm.occupation, Normalize(0, 1), palette.OCCUPATION)
        add_bar(figure, left, shown, "occupation [0..1]")
        left.set_title("Occupation")
        shown = draw_layer(right, glrm.grid, glrm.confidence, Normalize(0, 255), palette.CONFIDENCE)
        add_bar(figure, right, shown, "confidence [0..255]")
        right.contour(*glrm.grid.centres_m(), glrm.confidence, [CONFIDENT], colors=["#ffffff"], linewidths=0.5)
        right.set_title("Confidence")
        for axes in (left, right):
            zoom(axes, extent)

    return palette.picture(
        (11.0, 4.9),
        "Final global map, cell by cell. Left, occupation: 1 (darkest) cannot be driven, from a slope of 0.3 on. "
        "Right, confidence: "
        "how much the map believes itself; the white line encloses what counts as mapped (64 and more).",
        "Two maps of the district from above: streets are light and buildings dark in the occupation layer; "
        "confidence is highest along the patrolled streets.",
        draw,
    )


def height_error(grid: Grid, against_surface_m: Layer, against_rule_m: Layer, extent: tuple[float, ...]) -> Picture:
    """Height of the final GLRM minus each of the two truths (NaN where not compared)."""
    limit = _round_limit(against_surface_m, against_rule_m)

    def draw(figure: Figure) -> None:
        for axes, layer, title in zip(
            figure.subplots(1, 2), (against_surface_m, against_rule_m),
            ("Against the true surface", "Against the same rules, ideal scans"), strict=True,
        ):  # fmt: skip
            shown = draw_layer(axes, grid, layer, Normalize(-limit, limit), palette.ERROR)
            add_bar(figure, axes, shown, "height error [m]")
            axes.set_title(title)
            zoom(axes, extent)

    return palette.picture(
        (11.0, 4.9),
        "Height of the global map minus the truth [m], cells with confidence 64 and more; blue is too low, red too "
        "high. Left against the "
        "true top surface: a robot on the street sees walls, not roofs, so buildings come out low whoever maps them. "
        "Right against what the same rules make of noise-free dense scans: what is left there is noise, pose error "
        "and route.",
        "Two error maps: large negative errors on buildings against the true surface, small errors against the ideal "
        "scans.",
        draw,
    )


def changes(
    grid: Grid, change_m: Layer, extent: tuple[float, ...], robot: str, local: tuple[Grid, Layer] | None
) -> Picture:
    """Final minus initial height of the global map and of one robot's local map, grey where nothing changed."""
    panels = [("Global map", grid, change_m, extent)]
    if local is not None:
        x0, y0, x1, y1 = local[0].extent_m
        panels.append((f"{robot}'s local map", *local, (x0, x1, y0, y1)))
    layers = [np.where(np.abs(change) > UNCHANGED_M, change, np.nan) for _, _, change, _ in panels]
    limit = _round_limit(*layers)

    def draw(figure: Figure) -> None:
        for axes, (title, cells, _, shown), layer in zip(figure.subplots(1, 2), panels, layers, strict=False):
            mapped = draw_layer(axes, cells, layer, Normalize(-limit, limit), palette.ERROR)
            add_bar(figure, axes, mapped, "final minus initial height [m]")
            axes.set_title(title)
            zoom(axes, shown)

    return palette.picture(
        (11.0, 4.9),
        "What the mission changed: final minus initial height [m]; red was raised, blue lowered, grey unchanged. "
        f"Left all robots together, right {robot} alone around where it stopped, against the prior cut into its cells.",
        "Two maps of height changes along the driven streets: small on open ground, large on façades.",
        draw,
    )


def surface_changes(glrm: CellMap, changes: Sequence[SurfaceChange], extent: tuple[float, ...]) -> Picture:
    """Where something appeared or went, over the occupation layer."""

    def draw(figure: Figure) -> None:
        axes = figure.subplots()
        draw_layer(axes, glrm.grid, glrm.occupation, Normalize(0, 1), palette.OCCUPATION)
        for gone, marker, colour, word in (
            (False, "^", palette.ROBOT_COLOURS[0], "appeared"), (True, "v", palette.ROBOT_COLOURS[2], "went"),
        ):  # fmt: skip
            places = [(c.x_m, c.y_m) for c in changes if (c.to_top_m is None) == gone]
            x_m, y_m = np.array(places, np.float64).reshape(-1, 2).T
            label = f"{word}: {len(places)}"
            axes.scatter(x_m, y_m, 36, colour, marker=marker, edgecolors=palette.PAPER, linewidths=0.7, label=label)
        axes.legend(loc="upper left", bbox_to_anchor=(1.01, 1.0))
        zoom(axes, extent)

    return palette.picture(
        (7.5, 4.6),
        "Cells of the global map on which something appeared, or from which something went, over its occupation.",
        f"The global map from above with {len(changes)} marks where its surface changed.",
        draw,
    )


def _round_limit(*layers: Layer) -> float:
    sizes = np.concatenate([np.abs(layer[np.isfinite(layer)]) for layer in layers])
    return float(max(0.5, np.ceil(2 * np.quantile(sizes, 0.97)) / 2)) if sizes.size else 1.0


def robot_paths(
    glrm: CellMap, communications: Layer, paths: dict[str, tuple[Path, Mask]],
    vehicles: list[Path], patrol_m: Path, base_m: tuple[float, float], extent: tuple[float, ...],
) -> Picture:  # fmt: skip
    """True paths (robot -> positions (n, 2), radio (n,)) over the occupation layer, radio shadow hatched.

    `vehicles` are paths (n, 2); patrol (m, 2).
    """

    def draw(figure: Figure) -> None:
        axes = figure.subplots()
        draw_layer(axes, glrm.grid, glrm.occupation * 0.55, Normalize(0, 1), "Greys")
        x, y = glrm.grid.centres_m()
        if (communications <= 0).any():
            axes.contourf(x, y, communications, [-1, 0.5], colors="none", hatches=["////"])
            axes.contour(x, y, communications, [0.5], colors=[palette.ALARM], linewidths=0.7)
        for path in vehicles:
            axes.plot(path[:, 0], path[:, 1], color=palette.QUIET, lw=0.7, ls=(0, (4, 3)))
        axes.plot(patrol_m[:, 0], patrol_m[:, 1], "o", ms=3.2, mfc="#ffffff", mec=palette.QUIET, mew=0.7)
        for i, (path, radio) in enumerate(paths.values()):
            _path(axes, path, radio, palette.robot_colour(i))
        axes.plot(*base_m, marker="^", ms=8, color=palette.INK, linestyle="none")
        axes.legend(handles=_path_legend(list(paths)), loc="upper left", bbox_to_anchor=(1.01, 1.0), fontsize=9)
        zoom(axes, extent)

    return palette.picture(
        (10.0, 6.4),
        "Where the robots drove. A full line: the radio reached the base; dotted red: silence, the robot went on "
        "mapping on its own. "
        "Hatched: the scenario's radio shadow. White dots are the patrol's waypoints.",
        "Map from above with one coloured path per robot along the streets, dotted red where the radio was down.",
        draw,
    )


def _path(axes: Axes, path: Path, radio: Mask, colour: str) -> None:
    on, off = np.where(radio[:, None], path, np.nan), np.where(radio[:, None], np.nan, path)
    axes.plot(on[:, 0], on[:, 1], color=colour, lw=1.8)
    axes.plot(off[:, 0], off[:, 1], color="#ffffff", lw=3.0)
    axes.plot(off[:, 0], off[:, 1], color=palette.ALARM, lw=1.8, ls=(0, (1, 1)))
    axes.plot(*path[0], marker="o", ms=7, mfc=colour, mec="#ffffff")
    axes.plot(*path[-1], marker="s", ms=6.5, mfc=colour, mec="#ffffff")


def _path_legend(robots: list[str]) -> list[Line2D]:
    lines = [Line2D([], [], color=palette.robot_colour(i), lw=1.8, label=r) for i, r in enumerate(robots)]
    quiet, ink = palette.QUIET, palette.INK
    return [
        *lines,
        Line2D([], [], color=palette.ALARM, lw=1.8, ls=(0, (1, 1)), label="no radio"),
        Line2D([], [], marker="o", color=quiet, ls="none", ms=7, label="start"),
        Line2D([], [], marker="s", color=quiet, ls="none", ms=6.5, label="end"),
        Line2D([], [], marker="o", mfc="#ffffff", mec=quiet, ls="none", ms=3.2, label="waypoint"),
        Line2D([], [], color=quiet, lw=0.7, ls=(0, (4, 3)), label="other vehicle"),
        Line2D([], [], marker="^", color=ink, ls="none", ms=8, label="base station"),
    ]
