"""The page of a map that was made of recordings: heights, what stands, what can be driven, how sure it all is."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.colors import LightSource, Normalize
from matplotlib.figure import Figure

from orograph.arrays import F64
from orograph.layers import CellMap
from orograph.report import page, palette
from orograph.report.maps import add_bar, draw_layer, shown_extent, zoom
from orograph.report.palette import Picture
from orograph.report.surfaces import height_limits
from orograph.storage.recorded_map import MapInfo

SHADE = 0.35
"""How much of a relief's light and shadow is laid over its colours."""
WIDTH_IN, HEIGHT_IN = 11.0, 7.5


def render_map(cells: CellMap, path_m: F64, info: MapInfo) -> str:
    """report.html: one self-contained page; `path_m` (n, 3) is where the sensor was."""
    extent = shown_extent(cells.grid, cells.known, 5.0)
    return page.template("map.html.j2").render(
        info=info, grid=cells.grid, heights=_heights(cells, path_m, extent),
        layers=_layers(cells, extent), known_m2=info.cells * info.cell_m**2,
        driven_m=float(np.linalg.norm(np.diff(path_m, axis=0), axis=1).sum()) if len(path_m) else None,
    )  # fmt: skip


def _size(extent: tuple[float, ...], panels: int) -> tuple[float, float]:
    wide, high = (extent[1] - extent[0]) * panels, extent[3] - extent[2]
    return WIDTH_IN, float(np.clip(WIDTH_IN * 0.86 * high / wide, 2.5, HEIGHT_IN))


def _heights(cells: CellMap, path_m: F64, extent: tuple[float, ...]) -> Picture:
    tops = np.asarray(cells.tops, np.float64)
    low, high = height_limits(tops)

    def draw(figure: Figure) -> None:
        axes = figure.subplots()
        norm: Any = Normalize(low, high)
        shown = draw_layer(axes, cells.grid, tops, norm, palette.HEIGHT)
        add_bar(figure, axes, shown, "height [m]")
        x0, y0, x1, y1 = cells.grid.extent_m
        light = LightSource(315, 45).hillshade(np.nan_to_num(tops, nan=low), dx=cells.grid.cell_m, dy=cells.grid.cell_m)
        shade = np.zeros((*light.shape, 4))
        shade[..., 3] = np.where(np.isfinite(tops), np.clip(0.72 - light, 0, 1) * SHADE * 2, 0)
        axes.imshow(shade, extent=(x0, x1, y0, y1), origin="lower", interpolation="none", rasterized=True)
        if len(path_m):
            axes.plot(path_m[:, 0], path_m[:, 1], color="#ffffff", lw=2.6)
            axes.plot(path_m[:, 0], path_m[:, 1], color=palette.ROBOT_COLOURS[1], lw=1.4)
            axes.plot(*path_m[0, :2], "o", ms=6, mfc=palette.ROBOT_COLOURS[1], mec="#ffffff")
        zoom(axes, extent)
        axes.ticklabel_format(useOffset=False, style="plain")

    return palette.picture(
        _size(extent, 1),
        "The upper surface from above: of what stands where the map knows it, else of the ground; grey was never seen. "
        "The line is where the sensor was, the dot where it began.",
        "Height map of the recorded surroundings with the path of the sensor.",
        draw,
    )


def _layers(cells: CellMap, extent: tuple[float, ...]) -> Picture:
    def draw(figure: Figure) -> None:
        shown = (
            ("Occupation", cells.occupation, Normalize(0, 1), palette.OCCUPATION, "occupation [0..1]"),
            ("Confidence", np.where(cells.known, cells.confidence, np.nan), Normalize(0, 255), palette.CONFIDENCE,
             "confidence [0..255]"),
        )  # fmt: skip
        for axes, (title, layer, norm, colours, label) in zip(figure.subplots(1, 2), shown, strict=True):
            add_bar(figure, axes, draw_layer(axes, cells.grid, layer, norm, colours), label)
            axes.set_title(title)
            zoom(axes, extent)
            axes.ticklabel_format(useOffset=False, style="plain")

    return palette.picture(
        _size(extent, 2),
        "Left, occupation: 1 (darkest) cannot be driven. Right, confidence: how much the map believes itself.",
        "Two maps from above: what can be driven, and how sure the map is.",
        draw,
    )
