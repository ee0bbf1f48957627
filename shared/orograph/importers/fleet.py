"""A scenario for a fleet of any size: a made-up town, starts spread over its streets, a patrol along all of them."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
import shapely

from orograph.arrays import F64
from orograph.importers.district import street_points
from orograph.importers.scenario import CELL_M, duration_s, scenario_name, start, xy
from orograph.importers.spread import spread
from orograph.importers.town import KERB_M, LANE_M, Town, houses, town
from orograph.randomness import stream

STREET_PER_ROBOT_M = 250.0
WAYPOINT_EVERY_M = 30.0
"""About: each street has whole stretches, and a waypoint on each crossing."""
ROBOTS_PER_SHADOW = 5
ROBOTS_PER_VEHICLE = 10
SHADOW_M = 12.0
"""Beyond its street on all sides."""
BASE_ROOM_M = 40.0
"""No radio shadow and no poor GPS so near to the base station."""
WAVES_M = ((2.0, 420.0), (1.0, 190.0), (0.2, 70.0))
"""Amplitude and wavelength of the relief: nowhere steeper than 0.1."""
LORRY_M = (8.0, 2.4, 3.1)
PRIOR = {"ground_error_m": 0.3, "shift_m": 1.0, "missing": 0.05, "extra": 0.05}


def content(folder: str, robots: int, seed: int) -> tuple[dict[str, Any], list[dict[str, Any]]]:
    """The scenario as plain values, equal for equal arguments; and its buildings."""
    random = stream(seed, "fleet", str(robots))
    place = town(STREET_PER_ROBOT_M * robots, random)
    cols, rows = (round(side_m / CELL_M) for side_m in place.size_m)
    base = place.crossings[0, 0]
    standing = houses(place, random)
    silent, canyons = _areas(place, robots, random)
    patrol, spots = _stretches(place)
    spots = spots[~shapely.dwithin(shapely.union_all(silent), shapely.points(spots[:, :2]), CELL_M)]  # orders get there
    street_m = sum(street.length for street in place.streets)
    scenario = {
        "name": scenario_name(folder),
        "title": f"A made-up town for a fleet of {robots}",
        "seed": seed,
        "duration_max_s": duration_s(street_m, robots),
        "grid": {"origin_m": [0, 0], "cell_m": CELL_M, "rows": rows, "cols": cols},
        "terrain": {"height_m": 10, "waves": list(_waves(random)), "mesh_cell_m": 4},
        "prior": PRIOR,
        "vehicles": list(_vehicles(place, 1 + robots // ROBOTS_PER_VEHICLE, random)),
        "gps_quality": {"default": 2, "areas": [_area(canyon, 1) for canyon in canyons]},
        "communications": {"default": 1, "areas": [_area(shadow, 0) for shadow in silent]},
        "robots": robots,
        "starts": [start(*spot) for spot in _spread(spots, base, robots)],
        "base_station_m": xy(base),
        "patrol": [xy(point) for point in patrol],
    }
    return scenario, standing


def readme(scenario: dict[str, Any], houses: int) -> Iterator[str]:
    """What its README.md says, by paragraphs."""
    robots, grid = scenario["robots"], scenario["grid"]
    size = f"{grid['cols'] * CELL_M:.0f} m x {grid['rows'] * CELL_M:.0f} m"
    silent, poor = len(scenario["communications"]["areas"]), len(scenario["gps_quality"]["areas"])
    waypoints, every = len(scenario["patrol"]), f"{WAYPOINT_EVERY_M:.0f} m"
    yield f"# {scenario['name']}"
    yield (
        f"**What it shows.** A fleet of {robots} in a made-up town of {size}: {houses} buildings (perimeter blocks,\n"
        f"halls, terraces, villas, towers, pavilions in parks), streets {2 * KERB_M:.0f} m wide, gentle relief.\n"
        f"Streets without radio: {silent}; with single GPS: {poor}; vehicles going round blocks: "
        f"{len(scenario['vehicles'])}. The prior is wrong\n"
        "as real ones are: its ground, where its buildings stand, some missing, some not there."
    )
    yield (
        f"**What to expect.** {waypoints} waypoints, on each crossing and about every {every} along each street,\n"
        f"{waypoints / robots:.1f} for each robot; {scenario['duration_max_s']} s at most. Starts are far apart, the"
        " first ones farthest: with\n`--robots` fewer drive, from places as well spread."
    )
    yield f"Made by `orograph fleet {robots} --seed {scenario['seed']}`, which makes the same again."


def _stretches(place: Town) -> tuple[F64, F64]:
    """Waypoints (n, 2), and middles (m, 3) between them with the street's heading [rad]."""
    along, middles, everywhere = [place.crossings.reshape(-1, 2)], [], shapely.box(0, 0, *place.size_m)
    for street in place.streets:
        every_m = street.length / round(street.length / WAYPOINT_EVERY_M)
        at_m = np.arange(every_m, street.length - every_m / 2, every_m)
        along.append(shapely.get_coordinates(shapely.line_interpolate_point(street, at_m)))
        middles.append(street_points([(street, {"highway": "road"})], everywhere, every_m))
    return np.concatenate(along), np.concatenate(middles)


def _spread(spots: F64, base: F64, robots: int) -> F64:
    """So many of the spots (n, 3), the one nearest to the base first, as far apart as can be."""
    apart_m = np.linalg.norm(spots[:, None, :2] - spots[:, :2], axis=2)
    nearest = int(np.argmin(np.linalg.norm(spots[:, :2] - base, axis=1)))
    chosen, _ = spread(lambda i, _: apart_m[i], robots, nearest)
    return spots[chosen]


def _areas(place: Town, robots: int, random: np.random.Generator) -> tuple[list[Any], list[Any]]:
    """Boxes round streets away from the base: without radio, and with single GPS; no street is both."""
    base = shapely.Point(place.crossings[0, 0])
    away = [street for street in place.streets if street.distance(base) > BASE_ROOM_M]
    count = 1 + robots // ROBOTS_PER_SHADOW
    drawn = [away[i] for i in random.permutation(len(away))[: 2 * count]]
    silent = [shapely.box(*street.buffer(SHADOW_M).bounds) for street in drawn[:count]]
    return silent, [shapely.box(*street.buffer(KERB_M).bounds) for street in drawn[count:]]


def _area(box: Any, value: int) -> dict[str, Any]:
    return {"rectangle_m": [round(side, 1) for side in box.bounds], "value": value}


def _waves(random: np.random.Generator) -> Iterator[dict[str, float]]:
    for amplitude_m, wavelength_m in WAVES_M:
        heading_deg, phase_deg = random.integers(0, 360, 2).tolist()
        yield {"amplitude_m": amplitude_m, "wavelength_m": wavelength_m,
               "heading_deg": heading_deg, "phase_deg": phase_deg}  # fmt: skip


def _vehicles(place: Town, count: int, random: np.random.Generator) -> Iterator[dict[str, Any]]:
    """One round each of so many blocks, every third a lorry."""
    blocks = place.blocks(LANE_M)
    for number, block in enumerate(random.permutation(len(blocks))[:count].tolist()):
        speed_mps, fraction = random.uniform((3, 0), (6, 1)).round(2).tolist()
        vehicle = {"loop": blocks[block].round(1).tolist(), "speed_mps": speed_mps, "start_fraction": fraction}
        yield {**vehicle, "size_m": list(LORRY_M)} if number % 3 == 2 else vehicle
