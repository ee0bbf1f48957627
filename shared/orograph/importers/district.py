"""From a map in degrees to a scenario's buildings and streets: local metres, heights, simple footprints."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pyproj
import shapely

from orograph.arrays import F64
from orograph.importers.tags import absence, height_m

YARD_MIN_M2 = 60.0
"""Smaller courtyards are filled: no robot gets into them and no laser sees them."""
FOOTPRINT_MIN_M2 = 12.0
SIMPLIFY_M = 0.4
DRIVABLE = frozenset({
    "primary", "secondary", "tertiary", "unclassified", "residential", "living_street", "pedestrian", "service", "road",
})  # fmt: skip
Polygons = list[tuple[shapely.Polygon, float]]
BBox = tuple[float, float, float, float]
"""West, south, east, north [deg]."""


def local_crs(bbox: BBox) -> str:
    """The district's map frame as a PROJ string: metres east and north of the box's south-west corner, WGS 84."""
    return f"+proj=tmerc +lat_0={bbox[1]!r} +lon_0={bbox[0]!r} +k=1 +x_0=0 +y_0=0 +ellps=WGS84 +units=m +no_defs"


def to_metres(geometries: Sequence[shapely.Geometry], crs: str) -> list[shapely.Geometry]:
    """Geometries in degrees (longitude, latitude) in metres of a local frame."""
    turn = pyproj.Transformer.from_crs("EPSG:4326", crs, always_xy=True).transform
    return list(shapely.transform(np.array(geometries, object), lambda xy: np.column_stack(turn(xy[:, 0], xy[:, 1]))))


@dataclass(frozen=True)
class Houses:
    """Footprints as simple polygons without holes, each with its height [m]; and what was guessed or left out."""

    walls: Polygons
    notes: Mapping[str, int]
    """In words -> how many."""


def houses(buildings: Iterable[tuple[shapely.Geometry, Mapping[str, str]]], area: shapely.Polygon) -> Houses:
    """The buildings that stand within `area` [m]."""
    walls: Polygons = []
    notes: Counter[str] = Counter()
    for shape, tags in buildings:
        inside = shapely.make_valid(shape).intersection(area)
        if inside.is_empty:
            continue
        if reason := absence(tags):
            notes[f"left out: {reason}"] += 1
            continue
        height, guessed = height_m(tags)
        pieces = [piece for piece in _simple(inside.simplify(SIMPLIFY_M)) if piece.area >= FOOTPRINT_MIN_M2]
        walls += [(piece, height) for piece in pieces]
        notes["height guessed by type"] += guessed and bool(pieces)
        notes[f"left out: smaller than {FOOTPRINT_MIN_M2:g} m2"] += not pieces
        notes["invalid, crossed outline mended"] += not shape.is_valid
    return Houses(walls, {what: n for what, n in notes.items() if n})


def _simple(shape: shapely.Geometry) -> Iterator[shapely.Polygon]:
    """Polygons without holes that cover the shape; a larger courtyard is kept by cutting through it."""
    for part in shapely.get_parts(shapely.make_valid(shape)):
        if part.geom_type != "Polygon":
            continue
        yards = [ring for ring in part.interiors if shapely.Polygon(ring).area >= YARD_MIN_M2]
        solid = shapely.Polygon(part.exterior, yards)
        if not yards:
            yield shapely.Polygon(solid.exterior)
            continue
        x0, y0, x1, y1 = solid.bounds
        cut = shapely.Polygon(yards[0]).centroid.x
        for half in (shapely.box(x0, y0, cut, y1), shapely.box(cut, y0, x1, y1)):
            yield from _simple(solid.intersection(half))


def street_points(
    streets: Iterable[tuple[shapely.Geometry, Mapping[str, str]]], area: shapely.Polygon, spacing_m: float
) -> F64:
    """Points (n, 3) each `spacing_m` along drivable streets within `area`: x, y [m] and the street's heading [rad]."""
    rows = []
    for line, tags in streets:
        if tags["highway"] not in DRIVABLE or tags.get("tunnel", "no") != "no" or tags.get("layer", "0") != "0":
            continue
        for part in shapely.get_parts(line.intersection(area)):
            if part.geom_type == "LineString" and part.length >= spacing_m:
                rows += [_point_at(part, d) for d in np.arange(0.5 * spacing_m, part.length, spacing_m)]
    return np.array(rows, np.float64).reshape(-1, 3)


def _point_at(line: Any, distance_m: float) -> tuple[float, float, float]:
    here, ahead = line.interpolate(distance_m), line.interpolate(min(distance_m + 1.0, line.length))
    return here.x, here.y, math.atan2(ahead.y - here.y, ahead.x - here.x)


def clear_of(points: F64, walls: Polygons, clearance_m: float) -> F64:
    """The points (n, 3) that keep this distance to every footprint."""
    tree = shapely.STRtree([wall for wall, _ in walls])
    spots = shapely.points(points[:, :2])
    near = tree.query(spots, predicate="dwithin", distance=clearance_m)[0]
    return np.delete(points, np.unique(near), axis=0)
