"""Ground of a scenario: a tilted plane through the map origin plus sines, exact and as a mesh."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from orograph.arrays import F64
from orograph.grid import Grid
from orograph.scenario import TerrainSpec, Wave
from orograph.scene.mesh import Mesh

MARGIN_M = 100.0
"""Ground goes on this far beyond the grid, so that rays near the edge meet what a robot would see."""
MARGIN_CELL_M = 10.0


def _phase(wave: Wave, x: F64, y: F64) -> tuple[F64, float, float]:
    wave_number = 2 * np.pi / wave.wavelength_m
    heading = np.radians(wave.heading_deg)
    kx, ky = wave_number * np.cos(heading), wave_number * np.sin(heading)
    return kx * x + ky * y + np.radians(wave.phase_deg), float(kx), float(ky)


def ground_height_m(terrain: TerrainSpec, x_m: npt.ArrayLike, y_m: npt.ArrayLike) -> F64:
    """Height [m] of the ground at points of any common shape."""
    x, y = np.asarray(x_m, np.float64), np.asarray(y_m, np.float64)
    height = terrain.height_m + terrain.slope_x * x + terrain.slope_y * y
    for wave in terrain.waves:
        height = height + wave.amplitude_m * np.sin(_phase(wave, x, y)[0])
    return np.asarray(height, np.float64)


def ground_gradient(terrain: TerrainSpec, x_m: npt.ArrayLike, y_m: npt.ArrayLike) -> tuple[F64, F64]:
    """Gradients along x and y [m/m] of the ground at points of any common shape."""
    x, y = np.asarray(x_m, np.float64), np.asarray(y_m, np.float64)
    gx, gy = np.zeros(np.broadcast(x, y).shape) + terrain.slope_x, np.zeros(np.broadcast(x, y).shape) + terrain.slope_y
    for wave in terrain.waves:
        phase, kx, ky = _phase(wave, x, y)
        slope = wave.amplitude_m * np.cos(phase)
        gx, gy = gx + slope * kx, gy + slope * ky
    return gx, gy


def _lines(low_m: float, high_m: float, cell_m: float) -> F64:
    """Mesh lines along one axis: fine over the grid, coarse in the margin, no seam between."""
    fine = np.linspace(low_m, high_m, max(2, round((high_m - low_m) / cell_m) + 1))
    outer = np.arange(MARGIN_CELL_M, MARGIN_M + 0.5 * MARGIN_CELL_M, MARGIN_CELL_M)
    return np.concatenate([low_m - outer[::-1], fine, high_m + outer])


def _lines_over(lines: F64, low_m: float, high_m: float) -> F64:
    """The lines of all strips that touch [low, high], at least one strip."""
    first = np.clip(np.searchsorted(lines, low_m, "right") - 1, 0, len(lines) - 2)
    last = np.clip(np.searchsorted(lines, high_m, "left"), first + 1, len(lines) - 1)
    return lines[first : last + 1]


def terrain_mesh(
    terrain: TerrainSpec, grid: Grid, rectangle_m: tuple[float, float, float, float] | None = None
) -> Mesh:
    """Ground over the grid and its margin, normals up; vertices lie on the exact ground.

    With `rectangle_m` (x_min, y_min, x_max, y_max) only the mesh cells that touch it: the same triangles, fewer.
    """
    x0, y0, x1, y1 = grid.extent_m
    x_lines, y_lines = _lines(x0, x1, terrain.mesh_cell_m), _lines(y0, y1, terrain.mesh_cell_m)
    if rectangle_m is not None:
        west, south, east, north = rectangle_m
        x_lines, y_lines = _lines_over(x_lines, west, east), _lines_over(y_lines, south, north)
    x, y = np.meshgrid(x_lines, y_lines)
    vertices = np.stack([x, y, ground_height_m(terrain, x, y)], axis=-1).reshape(-1, 3)
    index = np.arange(x.size, dtype=np.int32).reshape(x.shape)
    sw, se, nw, ne = index[:-1, :-1], index[:-1, 1:], index[1:, :-1], index[1:, 1:]
    faces = np.stack([sw, se, ne, sw, ne, nw], axis=-1).reshape(-1, 3)
    return Mesh(vertices, np.ascontiguousarray(faces))
