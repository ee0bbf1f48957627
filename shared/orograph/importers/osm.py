"""Reads buildings and streets from an OpenStreetMap extract (.osm.pbf), in degrees, with their tags."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

import osmium
import shapely
from osmium.osm import Area, Way

from orograph.importers.district import BBox

Feature = tuple[shapely.Geometry, Mapping[str, str]]
"""A geometry in (longitude, latitude) and its tags."""


class ExtractError(ValueError):
    """The file is not an OpenStreetMap extract that can be read."""


@dataclass(frozen=True)
class Extract:
    """What an extract holds within a box: building polygons and highway lines, each with its tags."""

    buildings: tuple[Feature, ...]
    streets: tuple[Feature, ...]
    parts: int
    """`building:part` areas, which are not read: a tower on an outline has the outline's height."""


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
    told = {key: tuple(f for f in features if key in f[1]) for key in ("building", "highway", "building:part")}
    return Extract(told["building"], told["highway"], len(told["building:part"]))


def _features(path: Path) -> Iterator[Feature]:
    """Polygons with a building tag, ways with a `highway` tag; those cut off at the extract's edge are left out.

    osmium makes no area of an outline that crosses itself: it is given as its invalid ring.
    """
    wanted = osmium.filter.KeyFilter("building", "building:part", "highway")
    geometry = osmium.geom.WKBFactory()
    crossed: dict[int, Feature] = {}
    for item in osmium.FileProcessor(str(path)).with_areas(wanted).with_filter(wanted):
        tags = dict(item.tags)
        try:
            if isinstance(item, Area) and "highway" not in tags:
                polygon = shapely.from_wkb(geometry.create_multipolygon(item))
                crossed.pop(item.orig_id() if item.from_way() else -1, None)
                yield polygon, tags
            elif isinstance(item, Way):
                line = shapely.from_wkb(geometry.create_linestring(item))
                if "highway" in tags:
                    yield line, tags
                elif item.is_closed() and len(line.coords) > 3:
                    crossed[item.id] = shapely.Polygon(line.coords), tags
        except (osmium.InvalidLocationError, RuntimeError):
            continue  # a way with missing nodes, or an area without a ring
    yield from crossed.values()
