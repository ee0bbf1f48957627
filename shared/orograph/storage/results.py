"""What a run says of itself in JSON: how the world ended it, who ran it and on what, and how it was judged.

Frozen and typed, to and from their files.
"""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, ClassVar, Literal, Self

from pydantic import BaseModel, BeforeValidator, ConfigDict, ValidationError, WithJsonSchema

from orograph.storage.run_folder import RUN, START, STUDY, SUMMARY, WORLD, FolderError, read_text, write_whole

if TYPE_CHECKING:
    from orograph.messages import RunEnd
    from orograph.scenario import Scenario


Figure = Annotated[
    float,
    BeforeValidator(lambda value: math.nan if value is None else value),
    WithJsonSchema({"anyOf": [{"type": "number"}, {"type": "null"}]}),
]
"""A measured quantity: NaN where there was nothing to measure, `null` in JSON."""


class _Frozen(BaseModel):
    model_config = ConfigDict(frozen=True, use_attribute_docstrings=True)


class Result(_Frozen):
    """Written as one file of the run folder."""

    FILE: ClassVar[str]

    def write(self, out: Path) -> None:
        """Write it into a run folder, whole or not at all."""
        write_whole(out / self.FILE, self.model_dump_json(indent=2) + "\n")

    @classmethod
    def read(cls, out: Path) -> Self:
        """What a run folder holds; raises FolderError."""
        try:
            return cls.model_validate_json(read_text(out, cls.FILE))
        except ValidationError as error:
            place = ".".join(str(part) for part in error.errors()[0]["loc"])
            raise FolderError(f"{out / cls.FILE}: {place}: {error.errors()[0]['msg']}") from None


class Start(Result):
    """When a run was begun: said in its folder, as whoever ends it may not have begun it."""

    FILE: ClassVar[str] = START

    unix_s: float


class WorldResult(Result):
    """How the world saw the run end."""

    FILE: ClassVar[str] = WORLD

    sim_time_s: float
    wall_time_s: float
    complete: bool
    """Every waypoint was visited and every robot flushed."""
    copies_equal: bool
    deterministic: bool
    """Nothing was lost that the scenario and the seed did not decide."""

    @classmethod
    def of(cls, stamp_ns: int, wall_time_s: float, ended: RunEnd | None, deterministic: bool) -> Self:
        """From the last frame's stamp and the orchestrator's word, None where it was not heard."""
        return cls(
            sim_time_s=stamp_ns / 1e9, wall_time_s=wall_time_s, complete=ended is not None and ended.complete,
            copies_equal=ended is not None and ended.copies_equal, deterministic=deterministic,
        )  # fmt: skip


class Machine(_Frozen):
    """What a run was made on: the paper's Table 1."""

    processor: str
    cores: int
    """That this process may use."""
    memory_bytes: int
    system: str
    python: str
    packages: dict[str, str]
    """Name -> version of what the figures depend on."""


class RunInfo(WorldResult):
    """A run as its runner describes it, with the world's word in it."""

    FILE: ClassVar[str] = RUN

    seed: int
    robots: int
    runner: str
    """in-process, processes or containers."""
    mode: Literal["lockstep", "paced"]
    commit: str
    started_unix_s: float | None = None
    machine: Machine | None = None

    @classmethod
    def ran(
        cls, result: WorldResult, scenario: Scenario, runner: str, commit: str,
        machine: Machine | None = None, started_unix_s: float | None = None,
    ) -> Self:  # fmt: skip
        """The world's result with what the runner knows."""
        return cls(
            **result.model_dump(), seed=scenario.seed, robots=scenario.robots, runner=runner, commit=commit,
            mode="lockstep" if scenario.time_scale == "max" else "paced", machine=machine,
            started_unix_s=started_unix_s,
        )  # fmt: skip


class HeightErrors(_Frozen):
    """Height of a map minus a truth's, over `cells` cells."""

    cells: int
    rmse_m: Figure
    mae_m: Figure
    bias_m: Figure
    p95_m: Figure


class MapScore(HeightErrors):
    """A map against one truth: of its confident cells, and of parts of them."""

    occupation_iou: Figure
    open_ground: HeightErrors
    buildings: HeightErrors
    by_confidence: tuple[HeightErrors, ...]


class Scores(_Frozen):
    """One kind of map against the true surface and against ideal scans."""

    surface: MapScore
    ideal: MapScore


class MapScores(_Frozen):
    """The global map and the robots' local maps."""

    glrm: Scores
    hrm: Scores


class MapFigures(_Frozen):
    """A map on some cells against the truth, cell by cell; shares are of 1."""

    ground_near_rmse_m: Figure
    """Open ground beside what stands."""
    ground_near_cells: int
    ground_away_rmse_m: Figure
    ground_away_cells: int
    object_mae_m: Figure
    """Tops of what stands, against the highest point in the cell."""
    object_rmse_m: Figure
    object_bias_m: Figure
    object_cells: int
    unknown: Figure
    """Cells of which the map knows no height."""
    precision: Figure
    """Of occupation: how much of what the map bars cannot be driven,"""
    recall: Figure
    """how much of what cannot be driven the map bars,"""
    iou: Figure
    """and both over either."""
    houses_drivable: Figure
    """Built-up cells that the map calls drivable."""


class PriorAndFinal(_Frozen):
    """The map before the first scan and at the end, on the same cells."""

    prior: MapFigures
    final: MapFigures


class Improvement(_Frozen):
    """What mapping made of the prior where the final map is confident, and wherever a scan left evidence."""

    confident: PriorAndFinal
    touched: PriorAndFinal


class Improvements(_Frozen):
    """The global map and the robots' local maps."""

    glrm: Improvement
    hrm: Improvement


class Spread(_Frozen):
    """Median and 95 % quantile of durations [ms]."""

    p50: Figure
    p95: Figure


class StudyRow(_Frozen):
    """Mapping time [s of simulation] with one number of robots, and how much faster that is than with one."""

    robots: int
    paper_s: float | None
    paper_speed_up: float | None
    mapping_s: float | None
    """Until 95 % of the same cells for all rows had confidence 64; None where a run never got there."""
    speed_up: float | None
    coverage: Figure
    sim_time_s: float
    rtf: float | None
    height_rmse_m: Figure
    """Global map against ideal scans."""
    copies_hash_equal: bool | None
    cells_lost: int | None
    run: str
    """Folder of the run, beside study.json."""


class Study(Result):
    """One scenario with different numbers of robots."""

    FILE: ClassVar[str] = STUDY

    scenario: str
    rows: tuple[StudyRow, ...]


class Contact(_Frozen):
    """A robot hit something, or was hit."""

    robot: str
    body: str
    """Another robot, `vehicle_000`, or `building`."""
    since_s: float
    newtons: float
    """The greatest force along the ground."""
    seconds: float
    """For how long it was pushed."""
    x_m: float
    y_m: float


class SurfaceChange(_Frozen):
    """Something appeared on a cell of the map, or went from it."""

    row: int
    col: int
    x_m: float
    y_m: float
    """The cell's middle."""
    since_s: float
    """When a robot's scan first showed it."""
    told_s: float
    """When the map manager was sure of it."""
    from_top_m: float | None
    """Height of what stood there; null where nothing did."""
    to_top_m: float | None


class Summary(Result):
    """A judged run: what people and tests read first."""

    FILE: ClassVar[str] = SUMMARY

    scenario: str
    seed: int
    robots: int
    robots_gone: tuple[str, ...]
    robots_revoked: tuple[str, ...]
    """Whose registers were taken out of the map."""
    mode: Literal["lockstep", "paced"]
    runner: str
    commit: str
    complete: bool
    """Every waypoint was visited, every robot flushed, and all copies are equal."""
    waypoints: int
    waypoints_missed: tuple[int, ...] | None
    """Places in `patrol` that nobody visited; null where the orchestrator left nothing."""
    contacts: tuple[Contact, ...]
    """Collisions, in the order of their ends."""
    surface_changes: tuple[SurfaceChange, ...]
    """What appeared or went while robots mapped, as the map manager told of it."""
    deterministic: bool
    sim_time_s: float
    wall_time_s: float
    rtf: float | None
    """Simulated seconds per second."""
    glrm_hash: str | None
    copies_hash_equal: bool | None
    glrm_is_own_fold: bool | None
    coverage: Figure
    """Share of the observable cells that are confident."""
    observable_cells: int
    mapping_time_s: dict[int, float | None]
    """Share of the observable cells [%] -> when it was reached."""
    stages_ms: dict[str, Spread]
    bytes_up_per_robot_s: float | None
    bytes_down_per_robot_s: float | None
    cells_acked: int | None
    cells_lost: int | None
    missing_parts: tuple[str, ...]
    score: MapScores
    improvement: Improvements
