"""`orograph import-osm`: a scenario folder from a piece of an OpenStreetMap extract."""

from __future__ import annotations

import argparse
import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import shapely
import yaml
from rich.console import Console

from orograph.arrays import F64
from orograph.errors import InputError
from orograph.importers.district import Polygons, clear_of, footprints, street_points, to_metres
from orograph.importers.spread import reachable_together, spread
from orograph.layers import Layer
from orograph.mission.distances import DrivingDistances
from orograph.registers import unpack
from orograph.scenario import Scenario
from orograph.scene.prior import prior_records

CELL_M = 5.0
SIDE_M = (100.0, 5000.0)
"""Shortest and longest side of a district."""
EDGE_M = 12.0
"""Patrol points keep this far from the map's edge."""
CLEARANCE_M = 5.0
"""Patrol points keep this far from walls: a street at least 10 m wide."""
SPACING_M = 8.0
ATTRIBUTION = "© OpenStreetMap contributors, Open Database License (ODbL) 1.0"

BBox = tuple[float, float, float, float]


def add_parser(subparsers: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Declare the command's options."""
    parser = subparsers.add_parser(
        "import-osm", help="make a scenario from an OpenStreetMap extract",
        description="Make a scenario folder from the buildings and streets of an OpenStreetMap extract.",
    )  # fmt: skip
    parser.add_argument("file", type=Path, metavar="FILE.osm.pbf", help="an extract, for instance of a city")
    parser.add_argument("--bbox", required=True, metavar="W,S,E,N", help="west,south,east,north in degrees")
    parser.add_argument("--out", type=Path, required=True, metavar="DIR", help="scenario folder, new or empty")
    parser.add_argument("--robots", type=int, default=3, metavar="N", help="how many robots drive (default: 3)")
    parser.add_argument("--waypoints", type=int, default=20, metavar="N", help="waypoints of the patrol (default: 20)")
    parser.set_defaults(main=main)


def main(args: argparse.Namespace) -> int:
    """Read, choose, write, and say whose map it is; raises InputError for what can't be imported."""
    from orograph.importers.osm import ExtractError, read_extract

    bbox = parse_bbox(args.bbox)
    if args.out.exists() and (not args.out.is_dir() or any(args.out.iterdir())):
        raise InputError(f"--out {args.out}: not an empty folder; name a new one or remove it")
    if not 1 <= args.robots <= 100 or not 1 <= args.waypoints <= 2000:
        raise InputError("--robots must be 1..100 and --waypoints 1..2000")
    with Console(stderr=True).status(f"reading {args.file.name}") as status:
        try:
            extract = read_extract(args.file, bbox)
        except ExtractError as error:
            raise InputError(str(error)) from None
        status.update("choosing a patrol")
        area = _area(bbox)
        walls = footprints([(to_metres(shape, bbox), tags) for shape, tags in extract.buildings], area)
        streets = [(to_metres(line, bbox), tags) for line, tags in extract.streets]
        points = clear_of(street_points(streets, area.buffer(-EDGE_M), SPACING_M), walls, CLEARANCE_M)
        if not walls or len(points) < args.robots:
            found = f"{len(walls)} buildings and {len(points)} points on streets at least 10 m wide"
            raise InputError(f"--bbox {args.bbox}: holds {found}; choose another or larger district")
        content = scenario_content(args.out.name, area, walls, points, args.robots, args.waypoints)
    write(args.out, content, walls)
    print(f"{args.out}: {len(walls)} buildings, {len(content['patrol'])} waypoints, {len(content['starts'])} starts")
    print(f"The data is {ATTRIBUTION}: say so where you show it.")
    return 0


def parse_bbox(text: str) -> BBox:
    """West, south, east, north [deg]; raises InputError for anything else, or a district too small or too large."""
    try:
        west, south, east, north = (float(part) for part in text.split(","))
    except ValueError:
        raise InputError(
            f"--bbox {text}: expected west,south,east,north in degrees, e.g. 24.93,60.16,24.94,60.17"
        ) from None
    if not (-180 <= west < east <= 180 and -85 <= south < north <= 85):
        raise InputError(f"--bbox {text}: west must be less than east, south less than north")
    width, height = _area((west, south, east, north)).bounds[2:]
    if not (SIDE_M[0] <= width <= SIDE_M[1] and SIDE_M[0] <= height <= SIDE_M[1]):
        raise InputError(
            f"--bbox {text}: {width:.0f} m x {height:.0f} m; sides must be {SIDE_M[0]:.0f} to {SIDE_M[1]:.0f} m"
        )
    return west, south, east, north


def _area(bbox: BBox) -> Any:
    """The district [m] cut down to whole GLRM cells."""
    east, north = to_metres(shapely.Point(bbox[2], bbox[3]), bbox).coords[0]
    return shapely.box(0.0, 0.0, math.floor(east / CELL_M) * CELL_M, math.floor(north / CELL_M) * CELL_M)


def scenario_content(name: str, area: Any, walls: Polygons, points: F64, robots: int, waypoints: int) -> dict[str, Any]:
    """The scenario as plain values, its patrol on `points` (n, 3) that are all reachable from each other."""
    width, height = area.bounds[2:]
    content: dict[str, Any] = {
        "name": "".join(c if c.isalnum() else "-" for c in name.lower()).strip("-") or "district",
        "title": f"{name}, a district from OpenStreetMap",
        "attribution": ATTRIBUTION,
        "duration_max_s": 900,
        "grid": {"origin_m": [0, 0], "cell_m": CELL_M, "rows": round(height / CELL_M), "cols": round(width / CELL_M)},
        "terrain": {"height_m": 10, "waves": [{"amplitude_m": 1.0, "wavelength_m": 300, "heading_deg": 30}]},
        "robots": robots,
    }
    distance_m, points = _roads(content, walls, points)
    corner = int(np.argmin(points[:, 0] + points[:, 1]))
    starts = spread(distance_m, robots, corner)
    patrol = [i for i in spread(distance_m, waypoints + robots, corner) if i not in starts][:waypoints]
    return {
        **content,
        "starts": [_start(*points[i]) for i in starts],
        "base_station_m": _xy(points[corner]),
        "patrol": [_xy(points[i]) for i in patrol],
    }


def _roads(content: dict[str, Any], walls: Polygons, points: F64) -> tuple[F64, F64]:
    """Driving distances between the points that are all reachable from each other, and those points."""
    draft = Scenario.model_validate(
        {**content, "robots": 1, "buildings": _buildings(walls), "patrol": [_xy(points[0])],
         "base_station_m": _xy(points[0]), "starts": [_start(*points[0])]}
    )  # fmt: skip
    occupation: Layer = unpack(prior_records(draft), draft.grid.grid).occupation
    places = [(float(x), float(y)) for x, y, _ in points]
    distance_m = DrivingDistances(occupation, draft.grid.grid).between(places, places)
    kept = reachable_together(distance_m)
    return distance_m[np.ix_(kept, kept)], points[kept]


def _start(x_m: float, y_m: float, heading_rad: float) -> dict[str, float]:
    x_m, y_m, heading_deg = round(float(x_m), 1), round(float(y_m), 1), round(math.degrees(heading_rad))
    return {"x_m": x_m, "y_m": y_m, "heading_deg": heading_deg}


def _xy(point: F64) -> list[float]:
    return [round(float(point[0]), 1), round(float(point[1]), 1)]


def _buildings(walls: Polygons) -> list[dict[str, Any]]:
    rings = [(shapely.get_coordinates(wall.exterior)[:-1].round(2).tolist(), height) for wall, height in walls]
    return [{"footprint": ring, "height_m": height} for ring, height in rings]


def write(out: Path, content: dict[str, Any], walls: Polygons) -> None:
    """Write scenario.yaml, buildings.json and README.md; raises InputError where the folder can't be written."""
    try:
        out.mkdir(parents=True, exist_ok=True)
        lines = ",\n ".join(json.dumps(building) for building in _buildings(walls))
        (out / "buildings.json").write_text(f"[\n {lines}\n]\n")
        text = yaml.safe_dump(
            {**content, "buildings": {"file": "buildings.json"}},
            sort_keys=False,
            allow_unicode=True,
            default_flow_style=None,
        )
        (out / "scenario.yaml").write_text(f"# yaml-language-server: $schema=../scenario.schema.json\n{text}")
        (out / "README.md").write_text(f"# {content['title']}\n\nThe data is {ATTRIBUTION}.\n")
    except OSError as error:
        raise InputError(f"--out {out}: cannot be written ({error.strerror})") from None
