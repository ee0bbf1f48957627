"""What is known before the first scan: the ground, every building at one height, and the given layers."""

from __future__ import annotations

import numpy as np
import shapely

from orograph.arrays import F64
from orograph.grid import Grid
from orograph.layers import MAPPED_LAYERS, Layer
from orograph.messages import Packed
from orograph.registers import pack
from orograph.scenario import GivenLayer, Scenario
from orograph.scene.buildings import footprint_polygon
from orograph.scene.terrain import ground_gradient, ground_height_m

COVERED = 0.4
"""A cell holds a building from this covered share of its area on."""


def _cover_by(part: shapely.Polygon, grid: Grid, cover: F64) -> None:
    x0, y0, x1, y1 = part.bounds
    (row0, row1), (col0, col1) = grid.rows_cols([(x0, y0), (x1, y1)])
    rows, cols = (a.reshape(-1) for a in np.mgrid[max(row0, 0) : row1 + 1, max(col0, 0) : col1 + 1])
    inside = grid.contains(rows, cols)
    rows, cols = rows[inside], cols[inside]
    west, south = grid.origin_m[0] + cols * grid.cell_m, grid.origin_m[1] + rows * grid.cell_m
    cells = shapely.box(west, south, west + grid.cell_m, south + grid.cell_m)
    cover[rows, cols] += shapely.area(shapely.intersection(cells, part)) / grid.cell_m**2


def building_cover(scenario: Scenario, grid: Grid) -> F64:
    """Share of each cell's area (rows, cols) under footprints, overlaps counted once."""
    cover = np.zeros(grid.shape)
    together = shapely.union_all([footprint_polygon(building) for building in scenario.buildings])
    for part in shapely.get_parts(together):
        _cover_by(part, grid, cover)
    return cover


def prior_records(scenario: Scenario) -> Packed:
    """One UPDATE per GLRM cell, in cell order, seq and tick 0.

    A roof's gradients stay unknown: a flat roof must not look passable, so its occupation is 1 by decree.
    """
    grid = scenario.grid.grid
    x, y = np.meshgrid(*grid.centres_m())
    gradient_x, gradient_y = ground_gradient(scenario.terrain, x, y)
    roof = building_cover(scenario, grid) >= COVERED
    height = ground_height_m(scenario.terrain, x, y) + np.where(roof, scenario.prior.building_height_m, 0.0)
    occupation = np.minimum(1.0, np.hypot(gradient_x, gradient_y) / scenario.robot.slope_max)
    layers = {
        "height": height,
        "gradient_x": np.where(roof, np.nan, gradient_x),
        "gradient_y": np.where(roof, np.nan, gradient_y),
        "occupation": np.where(roof, 1.0, occupation),
        "confidence": np.full(grid.shape, scenario.prior.confidence),
    }
    values = np.stack([layers[name].reshape(-1) for name in MAPPED_LAYERS], axis=1)
    return pack(np.arange(grid.size), 0, values.astype(np.float32))


def _given(layer: GivenLayer, grid: Grid) -> Layer:
    x, y = np.meshgrid(*grid.centres_m())
    values = np.full(grid.shape, layer.default, np.float32)
    for area in layer.areas:
        x0, y0, x1, y1 = area.rectangle_m
        values[(x >= x0) & (x < x1) & (y >= y0) & (y < y1)] = area.value
    return values


def given_layers(scenario: Scenario) -> tuple[Layer, Layer]:
    """(gps_quality, communications), float32 (rows, cols) on the GLRM grid; a cell is in an area if its centre is."""
    grid = scenario.grid.grid
    return _given(scenario.gps_quality, grid), _given(scenario.communications, grid)
