"""What is known before the first scan: the ground, every building at one height, and the given layers.

What is wrong with it, where the scenario wants that: `believed_terrain`, `believed_buildings`.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
import shapely
from shapely import Polygon
from shapely.affinity import translate

from orograph.arrays import F64
from orograph.grid import Grid
from orograph.layers import MAPPED, Layer
from orograph.messages import Packed
from orograph.randomness import stream
from orograph.registers import pack
from orograph.rules import Rules
from orograph.scenario import GivenLayer, Scenario, TerrainSpec, Wave, places
from orograph.scene.buildings import footprint_polygon
from orograph.scene.terrain import ground_gradient, ground_height_m

COVERED = 0.4
"""A cell holds a building from this covered share of its area on."""
ERROR_WAVELENGTHS_M = (40.0, 55.0, 75.0, 100.0, 140.0, 190.0)
"""Of the waves that a wrong ground is made of: smooth over a house, different over a district."""
ROOM_M = 5.0
"""No building is invented so near to a place that the scenario names, or to a vehicle's loop."""
PLACING_TRIES = 20


def _cover_by(part: Polygon, grid: Grid, cover: F64) -> None:
    x0, y0, x1, y1 = part.bounds
    (row0, row1), (col0, col1) = grid.rows_cols([(x0, y0), (x1, y1)])
    rows, cols = (a.reshape(-1) for a in np.mgrid[max(row0, 0) : row1 + 1, max(col0, 0) : col1 + 1])
    inside = grid.contains(rows, cols)
    rows, cols = rows[inside], cols[inside]
    west, south = grid.origin_m[0] + cols * grid.cell_m, grid.origin_m[1] + rows * grid.cell_m
    cells = shapely.box(west, south, west + grid.cell_m, south + grid.cell_m)
    cover[rows, cols] += shapely.area(shapely.intersection(cells, part)) / grid.cell_m**2


def believed_terrain(scenario: Scenario) -> TerrainSpec:
    """The ground as the prior has it: the true one and some waves that are not there."""
    prior, random = scenario.prior, stream(scenario.seed, "prior", "ground")
    if prior.ground_error_m == 0:
        return scenario.terrain
    amplitude_m = prior.ground_error_m * (2 / len(ERROR_WAVELENGTHS_M)) ** 0.5
    headings_deg, phases_deg = random.uniform(0, 360, (2, len(ERROR_WAVELENGTHS_M)))
    wrong = [
        Wave(amplitude_m=amplitude_m, wavelength_m=length_m, heading_deg=heading_deg, phase_deg=phase_deg)
        for length_m, heading_deg, phase_deg in zip(ERROR_WAVELENGTHS_M, headings_deg, phases_deg, strict=True)
    ]
    return scenario.terrain.model_copy(update={"waves": (*scenario.terrain.waves, *wrong)})


def believed_buildings(scenario: Scenario) -> list[Polygon]:
    """The footprints as the prior has them: some missing, all shifted, some that are not there."""
    prior, random = scenario.prior, stream(scenario.seed, "prior", "buildings")
    true = [footprint_polygon(building) for building in scenario.buildings]
    shifts_m = prior.shift_m * random.standard_normal((len(true), 2))
    known = random.random(len(true)) >= prior.missing
    moved = [translate(p, *shift) for p, shift, k in zip(true, shifts_m.tolist(), known, strict=True) if k]
    return [*moved, *_invented(scenario, true, random)]


def _invented(scenario: Scenario, true: Sequence[Polygon], random: np.random.Generator) -> Iterator[Polygon]:
    """Copies of true footprints where nothing stands and nobody is to go, as many as fit in a few tries each."""
    x0, y0, x1, y1 = scenario.grid.grid.extent_m
    ways = (shapely.LinearRing(vehicle.loop) for vehicle in scenario.vehicles)
    stops = (shapely.Point(place) for _, place in places(scenario))
    taken = shapely.STRtree([*true, *(way.buffer(ROOM_M) for way in (*ways, *stops))])
    for _ in range(round(scenario.prior.extra * len(true))):
        footprint = true[int(random.integers(len(true)))]
        x, y = footprint.centroid.x, footprint.centroid.y
        for to_x, to_y in random.uniform((x0, y0), (x1, y1), (PLACING_TRIES, 2)).tolist():
            copy = translate(footprint, to_x - x, to_y - y)
            if not len(taken.query(copy, "intersects")):
                yield copy
                break


def building_cover(footprints: Sequence[Polygon], grid: Grid) -> F64:
    """Share of each cell's area (rows, cols) under footprints, overlaps counted once."""
    cover = np.zeros(grid.shape)
    together = shapely.union_all(footprints)
    for part in shapely.get_parts(together):
        _cover_by(part, grid, cover)
    return cover


def prior_records(scenario: Scenario) -> Packed:
    """One UPDATE per GLRM cell, in cell order, seq and tick 0.

    Of one surface a roof's gradients stay unknown: a flat roof must not look passable, so its occupation is 1 by
    decree. Of two the ground goes on below it, and the roof is the top.
    """
    grid, terrain = scenario.grid.grid, believed_terrain(scenario)
    if scenario.prior.confidence == 0:
        return _nothing(grid)
    x, y = np.meshgrid(*grid.centres_m())
    gradient_x, gradient_y = ground_gradient(terrain, x, y)
    roof = building_cover(believed_buildings(scenario), grid) >= COVERED
    ground_m = ground_height_m(terrain, x, y)
    top_m = np.where(roof, ground_m + scenario.prior.building_height_m, np.nan)
    occupation = np.minimum(1.0, np.hypot(gradient_x, gradient_y) / scenario.robot.slope_max)
    confidence = np.full(grid.shape, scenario.prior.confidence)
    layers = {
        "height": ground_m,
        "gradient_x": gradient_x,
        "gradient_y": gradient_y,
        "occupation": np.where(roof, 1.0, occupation),
        "confidence": confidence,
    }
    if Rules.of(scenario.rules).two_surfaces:
        layers |= {
            "height_top": top_m, "confidence_top": np.where(roof, confidence, 0),
            "wall_share": np.where(roof, 1.0, 0.0), "free_share": np.where(roof, 0.0, 1.0),
        }  # fmt: skip
    else:
        layers |= {
            "height": np.where(roof, top_m, ground_m), "gradient_x": np.where(roof, np.nan, gradient_x),
            "gradient_y": np.where(roof, np.nan, gradient_y),
        }  # fmt: skip
    blank = [np.full(grid.shape, kind.blank) for kind in MAPPED]
    values = np.stack([layers.get(kind.name, b).reshape(-1) for kind, b in zip(MAPPED, blank, strict=True)], axis=1)
    return pack(np.arange(grid.size), 0, values.astype(np.float32))


def _nothing(grid: Grid) -> Packed:
    return pack(np.arange(grid.size), 0, np.tile([kind.blank for kind in MAPPED], (grid.size, 1)))


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
