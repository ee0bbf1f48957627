"""The upper surface as a coloured mesh: a vertex a known cell, in metres from the map's south-west corner."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from orograph.arrays import F64, I64
from orograph.errors import InputError
from orograph.exporters.chart import Chart

Y_UP = np.array([[1.0, 0, 0, 0], [0, 0, 1, 0], [0, -1, 0, 0], [0, 0, 0, 1]])
"""glTF's frame: y up, the viewer looks along -z."""


def write_ply(path: Path, chart: Chart) -> None:
    """PLY, z up, the corner's place in its comment."""
    x_m, y_m = chart.grid.origin_m
    body = _mesh(chart).export(file_type="ply")
    place = f"comment origin {x_m!r} {y_m!r} crs {' '.join(chart.crs.split()) or 'none'}\n".encode()
    magic, form, rest = body.split(b"\n", 2)
    path.write_bytes(b"\n".join([magic, form, place + rest]))


def write_glb(path: Path, chart: Chart) -> None:
    """GLB, y up, the corner's place in the extras of its scene."""
    import trimesh

    scene: Any = trimesh.Scene(_mesh(chart), metadata={"origin_m": list(chart.grid.origin_m), "crs": chart.crs})
    scene.apply_transform(Y_UP)
    path.write_bytes(scene.export(file_type="glb"))


def _mesh(chart: Chart) -> Any:
    import trimesh
    from matplotlib import colormaps

    vertices, faces = surface(chart)
    if not len(vertices):
        raise InputError("no cell of the map has a height: there is no surface to write as a mesh")
    low, high = np.quantile(vertices[:, 2], [0.005, 0.995])
    share = np.clip((vertices[:, 2] - low) / max(high - low, 1e-6), 0, 1)
    colours = (colormaps["viridis"](share) * 255).round().astype(np.uint8)
    return trimesh.Trimesh(vertices, faces, vertex_colors=colours, process=False)


def surface(chart: Chart) -> tuple[F64, I64]:
    """Vertices (n, 3) [m] over the known cells' centres and triangles (m, 3) between neighbours, seen from above."""
    heights = np.asarray(chart.cells.tops, np.float64)
    told = chart.known & np.isfinite(heights)
    number = np.full(told.shape, -1, np.int64)
    number[told] = np.arange(told.sum())
    rows, cols = np.nonzero(told)
    cell_m = chart.grid.cell_m
    vertices = np.column_stack([(cols + 0.5) * cell_m, (rows + 0.5) * cell_m, heights[told]])
    here, right, above, across = number[:-1, :-1], number[:-1, 1:], number[1:, :-1], number[1:, 1:]
    halves = (here, right, across), (here, across, above)
    triangles = np.concatenate([np.stack(half, axis=-1).reshape(-1, 3) for half in halves])
    return vertices, triangles[(triangles >= 0).all(axis=1)]
