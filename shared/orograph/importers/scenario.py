"""A scenario from a district: grid, walls, starts and a patrol on its streets, as plain values and as a folder."""

from __future__ import annotations

import json
import math
import unicodedata
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import shapely
import yaml

from orograph.arrays import F64
from orograph.errors import InputError
from orograph.importers.district import Polygons
from orograph.importers.spread import spread
from orograph.layers import Layer
from orograph.mission.distances import DrivingDistances
from orograph.registers import unpack
from orograph.scenario import Scenario
from orograph.scene.prior import prior_records

CELL_M = 5.0
ATTRIBUTION = "© OpenStreetMap contributors, Open Database License (ODbL) 1.0"
NAME_LETTERS_MAX = 40
STREET_PER_WAYPOINT_M = 150.0
WAYPOINTS = (20, 300)
"""Fewest and most that are chosen where nobody says how many."""
DRIVE_MPS = 1.2
"""What is left of the robot's 3 m/s on a patrol with turns, waits and ways back."""
DURATION_S = (900, 7200)


def scenario_name(folder: str) -> str:
    """A permitted scenario name from any folder's name: `2024 Zürich` becomes `district-2024-zurich`."""
    plain = unicodedata.normalize("NFKD", folder).encode("ascii", "ignore").decode().lower()
    name = "-".join("".join(c if c.isalnum() else " " for c in plain).split())
    if not name[:1].isalpha():
        name = f"district-{name}".strip("-")
    return name[:NAME_LETTERS_MAX].strip("-")


def waypoints_for(streets: int, spacing_m: float) -> int:
    """How many waypoints suit a district with so many street points `spacing_m` apart."""
    fewest, most = WAYPOINTS
    return int(np.clip(round(streets * spacing_m / STREET_PER_WAYPOINT_M), fewest, most))


def whole_cells(east_m: float, north_m: float) -> Any:
    """The rectangle from the map frame's origin, cut down to whole GLRM cells."""
    return shapely.box(0.0, 0.0, math.floor(east_m / CELL_M) * CELL_M, math.floor(north_m / CELL_M) * CELL_M)


def content(
    folder: str, crs: str, area: Any, walls: Polygons, points: F64, robots: int, waypoints: int
) -> dict[str, Any]:
    """The scenario as plain values, its patrol on `points` (n, 3) that are all reachable from each other."""
    width, height = area.bounds[2:]
    ground: dict[str, Any] = {
        "name": scenario_name(folder),
        "title": f"{folder}, a district from OpenStreetMap"[:120],
        "attribution": ATTRIBUTION,
        "crs": crs,
        "grid": {"origin_m": [0, 0], "cell_m": CELL_M, "rows": round(height / CELL_M), "cols": round(width / CELL_M)},
        "terrain": {"height_m": 10, "waves": [{"amplitude_m": 1.0, "wavelength_m": 300, "heading_deg": 30}]},
        "robots": robots,
    }
    roads = _roads(ground, walls, points)
    points = points[roads.reachable_together(_places(points))]
    places = _places(points)
    corner = int(np.argmin(points[:, 0] + points[:, 1]))
    chosen, net_m = spread(lambda i, m: roads.between([places[i]], places, m)[0], waypoints + robots, corner)
    starts, patrol = chosen[:robots], chosen[robots:][:waypoints]
    return {
        **ground,
        "duration_max_s": duration_s(net_m, robots),
        "starts": [start(*points[i]) for i in starts],
        "base_station_m": xy(points[corner]),
        "patrol": [xy(points[i]) for i in patrol],
    }


def duration_s(net_m: float, robots: int) -> int:
    """Time for a patrol over places that a net of this length joins: twice its length, shared out."""
    return int(np.clip(math.ceil(2 * net_m / robots / DRIVE_MPS / 60) * 60 + 120, *DURATION_S))


def _roads(ground: dict[str, Any], walls: Polygons, points: F64) -> DrivingDistances:
    draft = Scenario.model_validate(
        {**ground, "robots": 1, "buildings": buildings(walls), "patrol": [xy(points[0])],
         "base_station_m": xy(points[0]), "starts": [start(*points[0])]}
    )  # fmt: skip
    occupation: Layer = unpack(prior_records(draft), draft.grid.grid).occupation
    return DrivingDistances(occupation, draft.grid.grid)


def _places(points: F64) -> list[tuple[float, float]]:
    return [(float(x), float(y)) for x, y, _ in points]


def start(x_m: float, y_m: float, heading_rad: float) -> dict[str, float]:
    """A start as a scenario spells it."""
    x_m, y_m, heading_deg = round(float(x_m), 1), round(float(y_m), 1), round(math.degrees(heading_rad))
    return {"x_m": x_m, "y_m": y_m, "heading_deg": heading_deg}


def xy(point: F64) -> list[float]:
    """A place as a scenario spells it, of which `point` has x and y [m] first."""
    return [round(float(point[0]), 1), round(float(point[1]), 1)]


def buildings(walls: Polygons) -> list[dict[str, Any]]:
    """The footprints as a scenario spells them."""
    rings = [(shapely.get_coordinates(wall.exterior)[:-1].round(2).tolist(), height) for wall, height in walls]
    return [{"footprint": ring, "height_m": height} for ring, height in rings]


def require_new(out: Path) -> None:
    """Raises InputError where `out` holds anything already."""
    if out.exists() and (not out.is_dir() or any(out.iterdir())):
        raise InputError(f"--out {out}: not an empty folder; name a new one or remove it")


def write(out: Path, scenario: dict[str, Any], houses: list[dict[str, Any]], told: Iterable[str]) -> None:
    """Write scenario.yaml, buildings.json and a README.md of these paragraphs into `out`; raises InputError."""
    lines = ",\n ".join(json.dumps(house) for house in houses)
    values = {**scenario, "buildings": {"file": "buildings.json"}}
    text = yaml.safe_dump(values, sort_keys=False, allow_unicode=True, default_flow_style=None)
    try:
        out.mkdir(parents=True, exist_ok=True)
        (out / "buildings.json").write_text(f"[\n {lines}\n]\n")
        (out / "scenario.yaml").write_text(f"# yaml-language-server: $schema=../scenario.schema.json\n{text}")
        (out / "README.md").write_text("\n\n".join(told).rstrip() + "\n")
    except OSError as error:
        raise InputError(f"--out {out}: cannot be written ({error.strerror})") from None


def readme(title: str, origin_deg: tuple[float, float], notes: Mapping[str, int]) -> Iterator[str]:
    """What a README.md says of a district, by paragraphs; `notes` count what the import guessed or left out."""
    place = f"longitude {origin_deg[0]}, latitude {origin_deg[1]} (WGS 84)"
    yield f"# {title}"
    yield f"The map frame's origin is {place}; `crs` in scenario.yaml is the frame itself."
    yield f"The data is {ATTRIBUTION}."
    if notes:
        yield "What the import guessed or left out, in buildings:"
        yield "".join(f"- {what}: {n}\n" for what, n in notes.items())
