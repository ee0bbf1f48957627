"""What a run is: the scenario file's vocabulary, with defaults beside fields (the scenario says *what*).

Positions are metres in the map frame, angles radians in code and degrees in the file where the name says so.
Checked with pydantic, the one exception to "words need NumPy only"; reading the file is `storage/scenario_file.py`.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Annotated, Literal, Self

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, PositiveFloat, PositiveInt, model_validator

from orograph import keys
from orograph.grid import Grid
from orograph.messages import (
    CELL_MAX_M,
    CELL_MIN_M,
    COLUMNS_MAX,
    GRID_SIDE_MAX,
    RINGS_MAX,
    ROBOTS_MAX,
    SPEED_MAX_MPS,
    VEHICLES_MAX,
    WAYPOINTS_MAX,
    YAW_RATE_MAX_RADPS,
)
from orograph.rules import NamedRules, Rules

Metres = Annotated[float, Field(allow_inf_nan=False, ge=-1e6, le=1e6)]
PointM = tuple[Metres, Metres]
PlaceM = Annotated[float, Field(allow_inf_nan=False, ge=-1e8, le=1e8)]
"""A coordinate in a frame of the whole Earth."""
Location = tuple[str | int, ...]
"""Where in the file: (`starts`, 2, `x_m`) is starts[2].x_m."""
Fraction = Annotated[float, Field(ge=0.0, le=1.0)]


class Part(BaseModel):
    """Frozen, no unknown keys: a typing mistake in a file is an error, not a silent default."""

    model_config = ConfigDict(frozen=True, extra="forbid", ser_json_inf_nan="strings")


JSON_MAX_BYTES = 32_000_000
"""A resolved scenario is told to every service as JSON of at most this length."""


class GridSpec(Part):
    """GLRM grid."""

    origin_m: PointM = (0.0, 0.0)
    cell_m: Annotated[float, Field(ge=CELL_MIN_M, le=CELL_MAX_M)] = 5.0
    rows: Annotated[int, Field(ge=4, le=GRID_SIDE_MAX)] = 200
    cols: Annotated[int, Field(ge=4, le=GRID_SIDE_MAX)] = 200

    @property
    def grid(self) -> Grid:
        """The GLRM's grid."""
        return Grid(self.origin_m, self.cell_m, (self.rows, self.cols))


class HrmSpec(Part):
    """Rolling high-resolution map: square, `cells` on a side, `per_glrm_cell` of them along one GLRM cell."""

    cells: Annotated[int, Field(ge=20, le=GRID_SIDE_MAX)] = 320
    per_glrm_cell: Annotated[int, Field(ge=1, le=100)] = 10

    @model_validator(mode="after")
    def _whole_blocks(self) -> Self:
        if self.cells % self.per_glrm_cell:
            raise ValueError(f"cells ({self.cells}) must be a multiple of per_glrm_cell ({self.per_glrm_cell})")
        return self


class Wave(Part):
    """One sine of the terrain: amplitude * sin(2 pi (x cos h + y sin h) / wavelength + phase)."""

    amplitude_m: Annotated[float, Field(ge=0, le=100)]
    wavelength_m: Annotated[float, Field(ge=10)]
    heading_deg: float = 0.0
    phase_deg: float = 0.0


class TerrainSpec(Part):
    """Ground: a tilted plane plus waves."""

    height_m: Metres = 0.0
    slope_x: Annotated[float, Field(ge=-0.3, le=0.3)] = 0.0
    slope_y: Annotated[float, Field(ge=-0.3, le=0.3)] = 0.0
    waves: tuple[Wave, ...] = ()
    mesh_cell_m: PositiveFloat = 2.0


class Building(Part):
    """A footprint (counter-clockwise or clockwise, not closed) raised to its height over the ground at its centroid."""

    footprint: Annotated[tuple[PointM, ...], Field(min_length=3)]
    height_m: Annotated[float, Field(gt=0, le=500)]
    roof: Literal["flat", "gable", "hip"] = "flat"
    roof_height_m: Annotated[float, Field(ge=0, le=50)] = 0.0
    """Part of height_m that the roof takes; gable and hip need a rectangular footprint."""


class Parked(Part):
    """A box that stands, its middle at (x_m, y_m); vehicles on loops do not see it."""

    x_m: Metres
    y_m: Metres
    heading_deg: float = 0.0
    size_m: tuple[PositiveFloat, PositiveFloat, PositiveFloat] = (4.2, 1.8, 1.6)


class Change(Part):
    """One thing that is built, parked or removed while robots map; with `until_s` it is undone again.

    A robot must not stand where something appears.
    """

    at_s: Annotated[float, Field(ge=0, le=7200)]
    until_s: Annotated[float, Field(gt=0)] = math.inf
    build: Building | None = None
    park: Parked | None = None
    remove: Annotated[int, Field(ge=0)] | None = None
    """Which of `buildings`, counted from 0."""

    @model_validator(mode="after")
    def _one_thing(self) -> Self:
        if sum(thing is not None for thing in (self.build, self.park, self.remove)) != 1:
            raise ValueError("a change has exactly one of build, park and remove")
        if self.until_s <= self.at_s:
            raise ValueError(f"until_s ({self.until_s:g}) must come after at_s ({self.at_s:g})")
        return self

    def holds(self, stamp_ns: int) -> bool:
        """Whether it has happened by then and is not undone."""
        until_ns = math.inf if math.isinf(self.until_s) else round(self.until_s * 1e9)
        return round(self.at_s * 1e9) <= stamp_ns < until_ns


class Vehicle(Part):
    """A box that drives a closed loop and stops for what stands before it."""

    loop: Annotated[tuple[PointM, ...], Field(min_length=3)]
    speed_mps: Annotated[float, Field(gt=0, le=30)] = 5.0
    size_m: tuple[PositiveFloat, PositiveFloat, PositiveFloat] = (4.2, 1.8, 1.6)
    start_fraction: Fraction = 0.0


class Area(Part):
    """A rectangle [x_min, y_min, x_max, y_max] with a value of a given layer; later areas win."""

    rectangle_m: tuple[Metres, Metres, Metres, Metres]
    value: Annotated[int, Field(ge=0, le=2)]

    @model_validator(mode="after")
    def _ordered(self) -> Self:
        x0, y0, x1, y1 = self.rectangle_m
        if x0 >= x1 or y0 >= y1:
            raise ValueError("rectangle_m is [x_min, y_min, x_max, y_max], min below max")
        return self


class GivenLayer(Part):
    """A layer that the scenario gives: one value everywhere, other values in areas."""

    default: Annotated[int, Field(ge=0, le=2)]
    areas: tuple[Area, ...] = ()


class Start(Part):
    """Where a robot stands at the beginning."""

    x_m: Metres
    y_m: Metres
    heading_deg: float = 0.0


class RobotSpec(Part):
    """Summit XL by its data sheet: size, mass, speed, four driven wheels, skid-steer."""

    size_m: tuple[PositiveFloat, PositiveFloat, PositiveFloat] = (0.72, 0.61, 0.42)
    mass_kg: PositiveFloat = 65.0
    wheel_radius_m: PositiveFloat = 0.11
    track_m: PositiveFloat = 0.50
    wheelbase_m: PositiveFloat = 0.45
    speed_max_mps: Annotated[float, Field(gt=0, le=SPEED_MAX_MPS)] = 3.0
    acceleration_max_mps2: PositiveFloat = 2.0
    yaw_rate_max_radps: Annotated[float, Field(gt=0, le=YAW_RATE_MAX_RADPS)] = 2.0
    wheel_torque_max_nm: PositiveFloat = 30.0
    slope_max: PositiveFloat = 0.3
    """Largest passable slope, the 0.3 of mapping.md section 2.3."""


class LaserSpec(Part):
    """One 3D laser on the robot's roof."""

    rings: Annotated[int, Field(ge=1, le=RINGS_MAX)] = 32
    columns: Annotated[int, Field(ge=8, le=COLUMNS_MAX)] = 720
    elevation_min_deg: Annotated[float, Field(ge=-90, le=90)] = -25.0
    elevation_max_deg: Annotated[float, Field(ge=-90, le=90)] = 25.0
    range_max_m: Annotated[float, Field(gt=1, le=130)] = 80.0
    range_min_m: Annotated[float, Field(ge=0)] = 0.4
    period_frames: PositiveInt = 4
    """Frames between scans: 4 frames of 0.1 s is 2.5 Hz."""
    noise_m: Annotated[float, Field(ge=0)] = 0.02
    dropout: Fraction = 0.01
    height_above_base_m: PositiveFloat = 0.45


class NavigationSensorsSpec(Part):
    """One sigma of GPS, IMU and odometry noise; white per sample unless the name says otherwise."""

    gps_single_m: PositiveFloat = 1.5
    gps_differential_m: PositiveFloat = 0.05
    gps_height_factor: PositiveFloat = 1.5
    attitude_deg: PositiveFloat = 0.1
    heading_deg: PositiveFloat = 0.4
    yaw_rate_radps: PositiveFloat = 0.002
    odometry_scale: Annotated[float, Field(ge=0, le=0.2)] = 0.01
    """Constant scale error of a robot's odometry, drawn once per run."""
    odometry_mps: PositiveFloat = 0.02


class RadioSpec(Part):
    """The modelled radio: loss anywhere, on top of the communications layer."""

    loss: Fraction = 0.0


class PriorSpec(Part):
    """What the GLRM holds before the first scan: the ground, and every building at one height.

    It is true unless told otherwise; what is wrong with it is drawn from the run's seed.
    """

    building_height_m: Annotated[float, Field(ge=0)] = 10.0
    confidence: Annotated[int, Field(ge=0, le=63)] = 32
    """0: nothing is known before the first scan."""
    ground_error_m: Annotated[float, Field(ge=0, le=5)] = 0.0
    """Root mean square of a smooth error of the ground."""
    shift_m: Annotated[float, Field(ge=0, le=20)] = 0.0
    """One sigma, along each axis, of how far each building is misplaced."""
    missing: Fraction = 0.0
    """Share of the buildings that it does not know."""
    extra: Fraction = 0.0
    """Buildings that are not there, as a share of those that are; never where a robot or vehicle is to go."""


class Scenario(Part):
    """One experiment, complete."""

    name: Annotated[str, Field(pattern=r"^[a-z][a-z0-9-]{0,40}$")]
    title: Annotated[str, Field(min_length=1, max_length=120)]
    attribution: str = ""
    crs: Annotated[str, Field(max_length=400)] = ""
    """The map frame on Earth, as PROJ or EPSG spell it; empty for a made-up place."""
    crs_origin_m: tuple[PlaceM, PlaceM] = (0.0, 0.0)
    """Where in it the map frame's origin lies, east and north: for instance in a UTM zone."""
    seed: Annotated[int, Field(ge=0, lt=2**31)] = 1
    duration_max_s: Annotated[float, Field(gt=1, le=7200)] = 600.0
    """The mission is flushed at this simulation time if it has not ended before."""
    time_scale: Literal["max"] | PositiveFloat = "max"
    frame_ms: Annotated[int, Field(ge=20, le=500, multiple_of=5)] = 100
    grid: GridSpec = GridSpec()
    hrm: HrmSpec = HrmSpec()
    rules: NamedRules | Rules = "surface"
    terrain: TerrainSpec = TerrainSpec()
    buildings: tuple[Building, ...] = ()
    vehicles: Annotated[tuple[Vehicle, ...], Field(max_length=VEHICLES_MAX)] = ()
    changes: Annotated[tuple[Change, ...], Field(max_length=100)] = ()
    """What is built, parked and removed while robots map."""
    gps_quality: GivenLayer = GivenLayer(default=2)
    communications: GivenLayer = GivenLayer(default=1)
    robots: Annotated[int, Field(ge=1, le=ROBOTS_MAX)] = 3
    """How many drive unless told otherwise; at most as many as there are starts."""
    starts: Annotated[tuple[Start, ...], Field(min_length=1, max_length=ROBOTS_MAX)]
    base_station_m: PointM
    patrol: Annotated[tuple[PointM, ...], Field(min_length=1, max_length=WAYPOINTS_MAX)]
    """Waypoints that the robots share out and visit."""
    robot: RobotSpec = RobotSpec()
    laser: LaserSpec = LaserSpec()
    navigation_sensors: NavigationSensorsSpec = NavigationSensorsSpec()
    radio: RadioSpec = RadioSpec()
    prior: PriorSpec = PriorSpec()

    @property
    def frame_ns(self) -> int:
        """Length of one frame."""
        return self.frame_ms * 1_000_000

    @property
    def robot_ids(self) -> tuple[str, ...]:
        """Ids of the run's robots, robot i from the i-th start."""
        return tuple(keys.robot_id(i + 1) for i in range(self.robots))

    @property
    def max_robots(self) -> int:
        """As many robots as there are places to start from."""
        return len(self.starts)

    @model_validator(mode="after")
    def _consistent(self) -> Self:
        problems = tuple(inconsistencies(self))
        if problems:
            raise InconsistentError(problems)
        return self


class InconsistentError(ValueError):
    """Fields that are right one by one and do not fit together; `problems` are pairs (location, text)."""

    def __init__(self, problems: tuple[tuple[Location, str], ...]) -> None:
        super().__init__("; ".join(text for _, text in problems))
        self.problems = problems


def inconsistencies(scenario: Scenario) -> Iterator[tuple[Location, str]]:
    """Pairs (location, text) of what does not fit together: too few starts, places off the grid or in a building."""
    if scenario.robots > len(scenario.starts):
        yield ("robots",), f"{scenario.robots} robots need as many starts, found {len(scenario.starts)}"
    if (size := len(scenario.model_dump_json())) > JSON_MAX_BYTES:
        yield ("buildings",), f"the scenario takes {size} bytes as JSON, at most {JSON_MAX_BYTES} can be told"
    fine_m = scenario.grid.cell_m / scenario.hrm.per_glrm_cell
    if fine_m < CELL_MIN_M:
        yield ("hrm", "per_glrm_cell"), f"makes cells of {fine_m:g} m, at least {CELL_MIN_M:g} m are needed"
    for i, area in enumerate(scenario.communications.areas):
        if area.value > 1:
            yield ("communications", "areas", i, "value"), f"communications are 0 or 1, found {area.value}"
    for i, change in enumerate(scenario.changes):
        if change.remove is not None and change.remove >= len(scenario.buildings):
            yield ("changes", i, "remove"), f"buildings[{change.remove}] is not there, found {len(scenario.buildings)}"
    yield from _starts_too_near(scenario)
    boxes = np.array([_bounds(b.footprint) for b in scenario.buildings]).reshape(-1, 4)
    for loc, (x, y) in places(scenario):
        if scenario.grid.grid.row_col(x, y) is None:
            yield loc, f"({x:g}, {y:g}) lies outside the grid"
        near = (boxes[:, 0] <= x) & (x <= boxes[:, 2]) & (boxes[:, 1] <= y) & (y <= boxes[:, 3])
        for index in np.flatnonzero(near).tolist():
            if _inside(x, y, scenario.buildings[index].footprint):
                yield loc, f"({x:g}, {y:g}) lies in buildings[{index}]"


def _starts_too_near(scenario: Scenario) -> Iterator[tuple[Location, str]]:
    """Robots would start inside each other."""
    places_m = np.array([(s.x_m, s.y_m) for s in scenario.starts])
    length_m = math.hypot(*scenario.robot.size_m[:2])
    for i in range(1, len(places_m)):
        apart_m = np.hypot(*(places_m[:i] - places_m[i]).T)
        if (nearest := int(np.argmin(apart_m))) >= 0 and apart_m[nearest] < length_m:
            yield ("starts", i), f"{apart_m[nearest]:.1f} m from starts[{nearest}]; robots are {length_m:.2f} m long"


def places(scenario: Scenario) -> Iterator[tuple[Location, PointM]]:
    """Every place that the scenario names, with where in the file: starts, waypoints, base, corners of loops."""
    for i, start in enumerate(scenario.starts):
        yield ("starts", i), (start.x_m, start.y_m)
    for i, waypoint in enumerate(scenario.patrol):
        yield ("patrol", i), waypoint
    yield ("base_station_m",), scenario.base_station_m
    for i, vehicle in enumerate(scenario.vehicles):
        for j, corner in enumerate(vehicle.loop):
            yield ("vehicles", i, "loop", j), corner


def _bounds(footprint: tuple[PointM, ...]) -> tuple[float, float, float, float]:
    xs, ys = [x for x, _ in footprint], [y for _, y in footprint]
    return min(xs), min(ys), max(xs), max(ys)


def _inside(x: float, y: float, footprint: tuple[PointM, ...]) -> bool:
    """Whether a point lies in a polygon, by the parity of the edges that a ray towards +x crosses."""
    edges = zip(footprint, (*footprint[1:], footprint[0]), strict=True)
    return (
        sum((y0 > y) != (y1 > y) and x < x0 + (y - y0) * (x1 - x0) / (y1 - y0) for (x0, y0), (x1, y1) in edges) % 2 == 1
    )
