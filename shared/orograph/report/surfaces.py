"""The paper's Figs. 11-15: the scene around the first robot, initial and final heights of its HRM and of the GLRM."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import LinearSegmentedColormap, Normalize
from matplotlib.figure import Figure

from orograph.arrays import F64
from orograph.grid import Grid
from orograph.report import palette
from orograph.report.axonometric import Relief, draw_relief, picture_height, project
from orograph.report.palette import HEIGHT, Picture

POINTS = "plasma"
CLAY = LinearSegmentedColormap.from_list("clay", ["#b9b2a3", "#e9e4d8", "#faf8f2"])
HALF_IN, FULL_IN = 5.6, 9.0


def height_limits(*layers: npt.NDArray[np.floating]) -> tuple[float, float]:
    """One colour range [m] for several height layers, so that colours compare: 0.5 and 99.5 % quantiles."""
    known = np.concatenate([layer[np.isfinite(layer)].reshape(-1) for layer in layers])
    if not known.size:
        return 0.0, 1.0
    low, high = np.quantile(known, [0.005, 0.995])
    return float(low), float(max(high, low + 1.0))


def surface(relief: Relief, limits_m: tuple[float, float], caption: str, alt: str) -> Picture:
    """One height layer as a surface with its colour bar, half a page wide."""

    def draw(figure: Figure) -> None:
        draw_relief(figure.subplots(), relief, limits_m)
        _bar(figure, Normalize(*limits_m), HEIGHT, "height [m]")

    return palette.picture((HALF_IN, picture_height(relief, HALF_IN)), caption, alt, draw)


def scene_with_points(
    surroundings: Relief, points_m: F64, robot_m: F64, limits_m: tuple[float, float], robot: str
) -> Picture:
    """True surroundings of a robot at `robot_m` (3,) with the points (n, 3) of its last scan, coloured by distance."""
    clay = Relief(surroundings.grid, surroundings.height_m, surroundings.exaggeration, CLAY)
    distance_m = np.linalg.norm(points_m - robot_m, axis=1)
    norm = Normalize(0.0, max(float(distance_m.max(initial=1.0)), 1.0))
    colours = colormaps[POINTS](norm(distance_m))[:, :3]

    def draw(figure: Figure) -> None:
        axes = figure.subplots()
        draw_relief(axes, clay, limits_m, points_m, colours, 0.0028 * _side(clay.grid))
        _robot_mark(axes, clay, robot_m, robot)
        _bar(figure, norm, POINTS, "distance from the robot [m]")

    return palette.picture(
        (FULL_IN, picture_height(clay, FULL_IN)),
        f"The true scene around {robot} at the end of the run (clay, taller is paler) with the {len(points_m):,} "
        f"points of its "
        "last scan, coloured by distance [m]. Rings on the ground, stripes on the walls, and shadow behind them. "
        "True proportions.",
        f"Oblique view of streets and buildings around {robot}, coloured laser points on the ground and on the walls.",
        draw,
    )


def _robot_mark(axes: Axes, relief: Relief, robot_m: F64, robot: str) -> None:
    foot = robot_m[2] - float(np.nanmin(relief.height_m))
    at = project(robot_m[:1], robot_m[1:2], np.array([foot * relief.exaggeration]))[0]
    axes.plot(*at, "o", ms=6, mfc=palette.ALARM, mec="#ffffff", zorder=5)
    label = axes.annotate(robot, at, (8, 8), textcoords="offset points", fontsize=9, color=palette.INK, zorder=5)
    label.set_bbox({"facecolor": palette.PAPER, "alpha": 0.8, "edgecolor": "none", "pad": 1.5})


def _side(grid: Grid) -> float:
    x0, y0, x1, y1 = grid.extent_m
    return max(x1 - x0, y1 - y0)


def _bar(figure: Figure, norm: Normalize, colours: str, label: str) -> None:
    bar = figure.colorbar(ScalarMappable(norm, colours), ax=figure.axes[0], shrink=0.7, pad=0.01, aspect=26)
    bar.set_label(label)
    bar.outline.set_linewidth(0.4)
