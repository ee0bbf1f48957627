"""The map from above as a small picture: what a scale says of every cell, and where the robots are."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from orograph.arrays import U1
from orograph.console.colours import Look, Scale, robot_rgb
from orograph.console.film import RADIO, Film
from orograph.grid import Grid

SIDE_PX = 480


def overview(film: Film, look: Look, scale: Scale, stamp_ns: int) -> U1:
    """RGB (height, width, 3), north up: robots as discs in their colours, hollow where they have no radio."""
    grid = film.site.scenario.grid.grid
    zoom = _zoom(grid)
    picture = np.asarray(np.clip(scale.rgb(look), 0, 1) * 255, np.uint8).repeat(zoom, 0).repeat(zoom, 1)
    for i, robot in enumerate(film.robots):
        pose = film.pose(robot, stamp_ns)
        if pose is not None:
            _disc(picture, grid, zoom, (pose[1], pose[2]), robot_rgb(i), hollow=not pose[RADIO])
    _disc(picture, grid, zoom, film.site.scenario.base_station_m, (255, 255, 255), hollow=True)
    return picture[::-1]


def _disc(
    picture: npt.NDArray[np.uint8], grid: Grid, zoom: int, at_m: tuple[float, float], rgb: tuple[int, int, int],
    hollow: bool,
) -> None:  # fmt: skip
    x, y = ((at - origin) / grid.cell_m * zoom for at, origin in zip(at_m, grid.origin_m, strict=True))
    rows, cols = np.ogrid[: picture.shape[0], : picture.shape[1]]
    away = np.hypot(rows - y, cols - x)
    radius = SIDE_PX / 60
    picture[away < radius + 2] = (20, 24, 28)
    picture[away < radius] = (255, 255, 255)
    if not hollow:
        picture[away < radius - 1] = rgb


def blank(grid: Grid) -> U1:
    """A picture of nothing, in the size of `overview`."""
    return np.zeros((grid.rows * _zoom(grid), grid.cols * _zoom(grid), 3), np.uint8)


def _zoom(grid: Grid) -> int:
    """Pixels on a cell's side."""
    return max(1, SIDE_PX // max(grid.shape))
