"""The paper's Figs. 11-15: the scene around the first robot, and initial and final heights of its HRM and of the GLRM."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from matplotlib import colormaps
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Normalize
from matplotlib.figure import Figure

from orograph.grid import Grid
from orograph.report import palette
from orograph.report.axonometric import Relief, draw_relief
from orograph.report.palette import HEIGHT, Picture

F64 = npt.NDArray[np.float64]
POINT_COLOURS = "magma"


def height_limits(*layers: npt.NDArray[np.floating]) -> tuple[float, float]:
    """One colour range [m] for several height layers, so that colours compare: 0.5 and 99.5 % quantiles."""
    known = np.concatenate([layer[np.isfinite(layer)].reshape(-1) for layer in layers])
    if not known.size:
        return 0.0, 1.0
    low, high = np.quantile(known, [0.005, 0.995])
    return float(low), float(max(high, low + 1.0))


def surface(
    relief: Relief, limits_m: tuple[float, float], caption: str, alt: str, size_in: tuple[float, float] = (7.2, 5.2)
) -> Picture:
    """One height layer as a surface with its colour bar."""

    def draw(figure: Figure) -> None:
        axes = figure.subplots()
        draw_relief(axes, relief, limits_m)
        _bar(figure, limits_m)

    return palette.picture(size_in, caption, alt, draw)


def scene_with_points(surroundings: Relief, points_m: F64, limits_m: tuple[float, float], robot: str) -> Picture:
    """True surroundings of a robot with the points (n, 3) of its last scan."""
    if len(points_m):
        distance = np.hypot(*(points_m[:, :2] - points_m[:, :2].mean(axis=0)).T)
        colours = colormaps[POINT_COLOURS](0.25 + 0.6 * np.clip(distance / max(distance.max(), 1e-6), 0, 1))[:, :3]
    else:
        colours = np.zeros((0, 3))

    def draw(figure: Figure) -> None:
        axes = figure.subplots()
        pale = Relief(surroundings.grid, surroundings.height_m, surroundings.exaggeration)
        draw_relief(axes, pale, limits_m, points_m, colours, 0.0022 * _side(surroundings.grid))
        _bar(figure, limits_m)

    return palette.picture(
        (7.2, 5.2),
        f"The true scene around {robot} at the end of the run, with the {len(points_m):,} points of its last scan "
        "(dark near, light far). Heights in metres, true proportions.",
        f"Oblique view of streets and buildings around {robot}, laser points on the ground and on the walls.",
        draw,
    )


def _side(grid: Grid) -> float:
    x0, y0, x1, y1 = grid.extent_m
    return max(x1 - x0, y1 - y0)


def _bar(figure: Figure, limits_m: tuple[float, float]) -> None:
    shown = ScalarMappable(Normalize(*limits_m), HEIGHT)
    bar = figure.colorbar(shown, ax=figure.axes[0], shrink=0.55, pad=0.01, aspect=26)
    bar.set_label("height [m]")
    bar.outline.set_linewidth(0.4)  # type: ignore[operator]
