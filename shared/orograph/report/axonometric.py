"""Height layers as solid 2.5D surfaces: every cell a column, seen from south-south-west above, painted back to front.

The paper's Figs. 11-15. Columns instead of a stretched skin, so that walls stay walls;
points can be hung into the scene.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, cast

import numpy as np
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.collections import PolyCollection
from matplotlib.colors import to_rgb

from orograph.arrays import F64
from orograph.grid import Grid
from orograph.report.palette import HEIGHT, INK, QUIET, UNKNOWN

TURN_RAD, TILT_RAD = np.radians(28.0), np.radians(38.0)
"""The view: from the south-south-west, 38 deg above the horizon; so south and west walls show."""
WALL_SHADE = (0.62, 0.78)
"""Brightness of walls that face west and south, against 1 for the tops."""
MAX_CELLS = 40_000


@dataclass(frozen=True, eq=False)
class Relief:
    """A height layer ready to be drawn: heights (rows, cols) [m], NaN unknown."""

    grid: Grid
    height_m: F64
    exaggeration: float = 1.0
    colours: Any = HEIGHT

    @property
    def span_m(self) -> tuple[float, float]:
        """Lowest and highest known height, both 0 where none is known."""
        known = self.height_m[np.isfinite(self.height_m)]
        return (float(known.min()), float(known.max())) if known.size else (0.0, 0.0)


def project(x_m: F64, y_m: F64, z_m: F64) -> F64:
    """Picture plane (n, 2) of points: right and up, in metres."""
    right = x_m * np.cos(TURN_RAD) - y_m * np.sin(TURN_RAD)
    away = x_m * np.sin(TURN_RAD) + y_m * np.cos(TURN_RAD)
    return np.stack([right, away * np.sin(TILT_RAD) + z_m * np.cos(TILT_RAD)], axis=-1)


def picture_height(relief: Relief, width: float) -> float:
    """Height of a picture of this width that the relief with its marks just fills."""
    x0, y0, x1, y1 = relief.grid.extent_m
    z = (relief.span_m[1] - relief.span_m[0]) * relief.exaggeration
    corners = project(np.array([x0, x1, x1, x0]), np.array([y0, y0, y1, y1]), np.zeros(4))
    wide, high = np.ptp(corners, axis=0)
    return float(width * 0.86 * (high + 0.6 * z * np.cos(TILT_RAD) + 0.1 * wide) / (1.12 * wide))


def depth(x_m: F64, y_m: F64) -> F64:
    """Distance from the viewer along the ground, up to a constant [m]."""
    along: F64 = x_m * np.sin(TURN_RAD) + y_m * np.cos(TURN_RAD)
    return along


def thinned(relief: Relief) -> Relief:
    """The same relief with at most MAX_CELLS cells: the highest of each block."""
    factor = int(np.ceil(np.sqrt(relief.grid.size / MAX_CELLS)))
    if factor <= 1:
        return relief
    height = _blocks(relief.height_m, factor)
    grid = Grid(relief.grid.origin_m, relief.grid.cell_m * factor, (height.shape[0], height.shape[1]))
    return Relief(grid, height, relief.exaggeration, relief.colours)


def _blocks(layer: F64, factor: int) -> F64:
    rows, cols = layer.shape[0] // factor, layer.shape[1] // factor
    cut = np.where(np.isnan(layer), -np.inf, layer)[: rows * factor, : cols * factor]
    highest = cut.reshape(rows, factor, cols, factor).max(axis=(1, 3))
    return np.where(np.isfinite(highest), highest, np.nan)


def draw_relief(
    axes: Axes, relief: Relief, limits_m: tuple[float, float],
    points_m: F64 | None = None, point_colours: Any = None, point_m: float = 0.25,
) -> None:  # fmt: skip
    """Paint a relief, coloured over `limits_m`, with points (n, 3) hung among the columns; axes in metres."""
    relief = thinned(relief)
    base = relief.span_m[0]
    faces, colours, order = _columns(relief, base, limits_m)
    if points_m is not None and len(points_m):
        dots, where = _dots(points_m, relief, base, point_m)
        faces, order = np.concatenate([faces, dots]), np.concatenate([order, where])
        colours = np.concatenate([colours, np.asarray(point_colours, np.float64)])
    back_to_front = np.argsort(-order, kind="stable")
    colours, ordered = colours[back_to_front], cast(Any, faces[back_to_front])  # an array is quicker than a list
    painted = PolyCollection(ordered, facecolors=colours, edgecolors=colours, linewidths=0.5, rasterized=True)
    # Left out of the layout's search for extents, which would walk every polygon; axes limits hold it anyway.
    painted.set_in_layout(False)
    axes.add_collection(painted, autolim=False)
    axes.update_datalim([faces.min(axis=(0, 1)), faces.max(axis=(0, 1))])
    _frame(axes, relief, base)


def _columns(relief: Relief, base: float, limits_m: tuple[float, float]) -> tuple[F64, F64, F64]:
    """Faces (n, 4, 2), colours (n, 3) and depths (n,) of every top and of the walls that face the viewer."""
    grid, cell = relief.grid, relief.grid.cell_m
    height = np.nan_to_num(relief.height_m, nan=base)
    z = (height - base) * relief.exaggeration
    x, y = np.meshgrid(*grid.centres_m())
    colour = _face_colours(relief, limits_m)
    south = np.vstack([np.zeros((1, grid.cols)), z[:-1]])
    west = np.hstack([np.zeros((grid.rows, 1)), z[:, :-1]])
    h = cell / 2
    tops = _quad(x, y, [(-h, -h), (h, -h), (h, h), (-h, h)], [z, z, z, z])
    fronts = _quad(x, y, [(-h, -h), (h, -h), (h, -h), (-h, -h)], [south, south, z, z])
    sides = _quad(x, y, [(-h, -h), (-h, h), (-h, h), (-h, -h)], [west, west, z, z])
    faces = [tops]
    painted, order = [colour.reshape(-1, 3)], [depth(x, y).reshape(-1)]
    for quads, foot, shade in ((fronts, south, WALL_SHADE[1]), (sides, west, WALL_SHADE[0])):
        shown = ((z - foot) > 0.01 * cell).reshape(-1)
        faces.append(quads[shown])
        painted.append(colour.reshape(-1, 3)[shown] * shade)
        order.append(depth(x, y).reshape(-1)[shown] - 1e-6 * cell)
    return np.concatenate(faces), np.concatenate(painted), np.concatenate(order)


def _quad(x: F64, y: F64, corners: list[tuple[float, float]], heights: list[F64]) -> F64:
    """Projected quads (rows * cols, 4, 2)."""
    ends = [project(x + dx, y + dy, z) for (dx, dy), z in zip(corners, heights, strict=True)]
    return np.stack(ends, axis=-2).reshape(-1, 4, 2)


def _face_colours(relief: Relief, limits_m: tuple[float, float]) -> F64:
    """Colours of the tops (rows, cols, 3): height under a light from the west, unknown in grey."""
    low, high = limits_m
    share = np.clip((relief.height_m - low) / max(high - low, 1e-6), 0, 1)
    rgb = np.asarray(colormaps.get_cmap(relief.colours)(np.nan_to_num(share)))[..., :3]
    rgb[np.isnan(relief.height_m)] = to_rgb(UNKNOWN)
    return np.clip(rgb * _light(relief)[..., None], 0, 1)


def _light(relief: Relief) -> F64:
    """Brightness 0.82 .. 1.08 of the tops by their slope against a low western sun."""
    z = np.nan_to_num(relief.height_m, nan=0.0) * relief.exaggeration
    slope = np.gradient(z, relief.grid.cell_m, axis=1) if relief.grid.cols > 1 else np.zeros_like(z)
    return 1.0 + np.clip(0.25 * slope, -0.18, 0.08)


def _dots(points_m: F64, relief: Relief, base: float, size_m: float) -> tuple[F64, F64]:
    z = (points_m[:, 2] - base) * relief.exaggeration
    centre = project(points_m[:, 0], points_m[:, 1], z)
    h = size_m / 2
    square = np.array([(-h, -h), (h, -h), (h, h), (-h, h)])
    nearer = depth(points_m[:, 0], points_m[:, 1]) - relief.grid.cell_m
    return centre[:, None, :] + square[None, :, :], nearer


def _frame(axes: Axes, relief: Relief, base: float) -> None:
    """Metre marks along the two near edges, and a scale for the height."""
    x0, y0, x1, y1 = relief.grid.extent_m
    size = max(x1 - x0, y1 - y0)
    axes.set_axis_off()
    axes.set_aspect("equal")
    for value in _marks(x0, x1):
        _mark(axes, (value, y0), (0.0, -0.02 * size), f"{value:g}", "center")
    for value in _marks(y0, y1):
        _mark(axes, (x0, value), (-0.02 * size, 0.0), f"{value:g}", "right")
    _mark(axes, ((x0 + x1) / 2, y0), (0.0, -0.11 * size), "x east [m]", "center", ticked=False)
    _mark(axes, (x0, (y0 + y1) / 2), (-0.13 * size, 0.0), "y north [m]", "right", ticked=False)
    axes.autoscale_view()
    axes.margins(0.01)


def _marks(low: float, high: float) -> list[float]:
    """Four to eight round values within [low, high]."""
    step = 10.0 ** np.floor(np.log10(high - low))
    step = next(s for s in (step, step / 2, step / 4, step / 5) if (high - low) / s >= 4 or s == step / 5)
    return [float(v) for v in np.arange(np.ceil(low / step) * step, high + step * 1e-6, step)]


def _mark(
    axes: Axes, xy: tuple[float, float], offset: tuple[float, float], label: str, align: str, ticked: bool = True
) -> None:
    ends = np.array([xy, (xy[0] + offset[0], xy[1] + offset[1])])
    line = project(ends[:, 0], ends[:, 1], np.zeros(2))
    if ticked:
        axes.plot(line[:, 0], line[:, 1], color=QUIET, lw=0.6, clip_on=False)
    axes.text(line[1, 0], line[1, 1], label, ha=align, va="top", fontsize=8, color=INK if not ticked else QUIET)
