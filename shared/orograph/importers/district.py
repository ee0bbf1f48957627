"""From a map in degrees to a scenario's buildings and streets: local metres, heights, simple footprints."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Iterator, Mapping
from typing import Any

import numpy as np
import shapely
from shapely import affinity

from orograph.arrays import F64

EARTH_RADIUS_M = 6_378_137.0
ECCENTRICITY_2 = 0.00669437999014
"""WGS 84."""
LEVEL_M = 3.2
ROOF_M = 1.0
"""A house of n levels is taken as n * 3.2 m + 1 m high."""
HEIGHT_BY_TYPE_M = {"garage": 3.0, "garages": 3.0, "shed": 2.5, "roof": 4.0, "kiosk": 3.0, "house": 7.0, "church": 20.0}
HEIGHT_DEFAULT_M = 10.0
YARD_MIN_M2 = 60.0
"""Smaller courtyards are filled: no robot gets into them and no laser sees them."""
FOOTPRINT_MIN_M2 = 12.0
SIMPLIFY_M = 0.4
DRIVABLE = frozenset(
    [
        "primary",
        "secondary",
        "tertiary",
        "unclassified",
        "residential",
        "living_street",
        "pedestrian",
        "service",
        "road",
    ]
)
Polygons = list[tuple[shapely.Polygon, float]]


def metres_per_degree(latitude_deg: float) -> tuple[float, float]:
    """(east, north) [m/deg] at a latitude, from the ellipsoid's radii of curvature."""
    s2 = math.sin(math.radians(latitude_deg)) ** 2
    across = EARTH_RADIUS_M / math.sqrt(1 - ECCENTRICITY_2 * s2)
    along = across * (1 - ECCENTRICITY_2) / (1 - ECCENTRICITY_2 * s2)
    return math.radians(1) * across * math.cos(math.radians(latitude_deg)), math.radians(1) * along


def to_metres(geometry: shapely.Geometry, bbox: tuple[float, float, float, float]) -> shapely.Geometry:
    """Degrees to metres east and north of the box's south-west corner, scaled at its middle latitude."""
    west, south, _, north = bbox
    east_m, north_m = metres_per_degree(0.5 * (south + north))
    return affinity.affine_transform(geometry, [east_m, 0, 0, north_m, -west * east_m, -south * north_m])


def height_m(tags: Mapping[str, str]) -> float:
    """A building's height by its tags: `height`, else `building:levels`, else a default by type."""
    for tag, factor, more in (("height", 1.0, 0.0), ("building:levels", LEVEL_M, ROOF_M)):
        found = re.match(r"\s*(\d+(?:[.,]\d+)?)", tags.get(tag, ""))
        if found and float(found[1].replace(",", ".")) > 0:
            return round(min(float(found[1].replace(",", ".")) * factor + more, 300.0), 1)
    return HEIGHT_BY_TYPE_M.get(tags["building"], HEIGHT_DEFAULT_M)


def footprints(buildings: Iterable[tuple[shapely.Geometry, Mapping[str, str]]], area: shapely.Polygon) -> Polygons:
    """Simple polygons without holes within `area` [m], each with its height [m]; tiny ones are dropped."""
    pieces = [
        (piece, height_m(tags))
        for shape, tags in buildings
        for piece in _simple(shape.intersection(area).simplify(SIMPLIFY_M))
    ]
    return [(piece, height) for piece, height in pieces if piece.area >= FOOTPRINT_MIN_M2]


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
