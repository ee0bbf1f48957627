"""Reads buildings and streets from an OpenStreetMap extract (.osm.pbf), in degrees, with their tags."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

import osmium
import shapely
from osmium.osm import Area, Way

BBox = tuple[float, float, float, float]
"""West, south, east, north [deg]."""
Feature = tuple[shapely.Geometry, Mapping[str, str]]
"""A geometry in (longitude, latitude) and its tags."""


class ExtractError(ValueError):
    """The file is not an OpenStreetMap extract that can be read."""


@dataclass(frozen=True)
class Extract:
    """What an extract holds within a box: building polygons and highway lines, each with its tags."""

    buildings: tuple[Feature, ...]
    streets: tuple[Feature, ...]


def read_extract(path: Path, bbox: BBox) -> Extract:
    """Buildings and highways that touch `bbox`, in the file's order; raises ExtractError where it can't be read."""
    if not path.is_file():
        raise ExtractError(f"{path}: no such file")
    box = shapely.box(*bbox)
    shapely.prepare(box)
    try:
        features = [feature for feature in _features(path) if box.intersects(feature[0])]
    except (RuntimeError, ValueError) as error:
        raise ExtractError(f"{path}: not an OpenStreetMap extract (.osm.pbf) that can be read: {error}") from None
    buildings = tuple(feature for feature in features if "building" in feature[1])
    return Extract(buildings, tuple(feature for feature in features if "highway" in feature[1]))


def _features(path: Path) -> Iterator[Feature]:
    """Polygons with a `building` tag, ways with a `highway` tag; those cut off at the extract's edge are left out."""
    wanted = osmium.filter.KeyFilter("building", "highway")
    geometry = osmium.geom.WKBFactory()
    for item in osmium.FileProcessor(str(path)).with_areas(wanted).with_filter(wanted):
        tags = dict(item.tags)
        try:
            if isinstance(item, Area) and "building" in tags:
                yield shapely.from_wkb(geometry.create_multipolygon(item)), tags
            elif isinstance(item, Way) and "highway" in tags:
                yield shapely.from_wkb(geometry.create_linestring(item)), tags
        except (osmium.InvalidLocationError, RuntimeError):
            continue  # a way with missing nodes, or an area without a ring
