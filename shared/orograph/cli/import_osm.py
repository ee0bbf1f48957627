"""`orograph import-osm`: a scenario folder from a piece of an OpenStreetMap extract."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from rich.console import Console

from orograph.errors import InputError

SIDE_M = (100.0, 5000.0)
"""Shortest and longest side of a district."""
EDGE_M = 12.0
"""Patrol points keep this far from the map's edge."""
CLEARANCE_M = 5.0
"""Patrol points keep this far from walls: a street at least 10 m wide."""
SPACING_M = 8.0

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
    parser.add_argument(
        "--waypoints", type=int, metavar="N", help="waypoints of the patrol (default: by the length of the streets)"
    )
    parser.set_defaults(main=main)


def main(args: argparse.Namespace) -> int:
    """Read, choose, write, say what was guessed and whose map it is; raises InputError for what can't be imported."""
    from orograph.importers import scenario as made
    from orograph.importers.district import clear_of, houses, local_crs, street_points, to_metres
    from orograph.importers.osm import ExtractError, read_extract

    bbox = parse_bbox(args.bbox)
    crs, area = local_crs(bbox), _area(bbox)
    made.require_new(args.out)
    if not 1 <= args.robots <= 100 or not 1 <= (args.waypoints or 1) <= 2000:
        raise InputError("--robots must be 1..100 and --waypoints 1..2000")
    with Console(stderr=True).status(f"reading {args.file.name}") as status:
        try:
            extract = read_extract(args.file, bbox)
        except ExtractError as error:
            raise InputError(str(error)) from None
        status.update(f"placing {len(extract.buildings)} buildings")
        shapes = to_metres([shape for shape, _ in extract.buildings], crs)
        standing = houses(zip(shapes, (tags for _, tags in extract.buildings), strict=True), area)
        lines = to_metres([line for line, _ in extract.streets], crs)
        streets = zip(lines, (tags for _, tags in extract.streets), strict=True)
        points = clear_of(street_points(streets, area.buffer(-EDGE_M), SPACING_M), standing.walls, CLEARANCE_M)
        if not standing.walls or len(points) < args.robots:
            found = f"{len(standing.walls)} buildings and {len(points)} points on streets at least 10 m wide"
            raise InputError(f"--bbox {args.bbox}: holds {found}; choose another or larger district")
        status.update(f"choosing a patrol on {len(points)} places")
        waypoints = args.waypoints or made.waypoints_for(len(points), SPACING_M)
        content = made.content(args.out.name, crs, area, standing.walls, points, args.robots, waypoints)
    notes = {**standing.notes, **({"building parts not read": extract.parts} if extract.parts else {})}
    told = made.readme(content["title"], bbox[:2], notes)
    made.write(args.out, content, made.buildings(standing.walls), told)
    print(f"{args.out}: {len(standing.walls)} buildings, {len(content['patrol'])} waypoints, "
          f"{len(content['starts'])} starts, {content['duration_max_s']} s at most")  # fmt: skip
    for what, count in notes.items():
        print(f"  {what}: {count}")
    print(f"The data is {made.ATTRIBUTION}: say so where you show it.")
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
    """The district [m], as wide as it is at its southern and high as at its western side."""
    import shapely

    from orograph.importers.district import local_crs, to_metres
    from orograph.importers.scenario import whole_cells

    east, north = to_metres([shapely.Point(bbox[2], bbox[1]), shapely.Point(bbox[0], bbox[3])], local_crs(bbox))
    return whole_cells(east.x, north.y)
