"""What the services left behind, as one object: the only input of score, checks and report."""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
from pydantic import ValidationError

from orograph import keys
from orograph.arrays import I64
from orograph.grid import Grid
from orograph.layers import BASIC_LAYERS, MAPPED_LAYERS, CellMap, Layer
from orograph.scenario import Scenario
from orograph.storage import run_folder
from orograph.storage.results import RunInfo

Arrays = Mapping[str, npt.NDArray[Any]]
EMPTY: Arrays = {}


@dataclass(frozen=True, eq=False)
class RunParts:
    """One run: its scenario, what the runner says of it, each node's artifacts, timings, radio bytes and events."""

    scenario: Scenario
    run: RunInfo
    nodes: Mapping[str, Arrays]
    """Node name (`laser/robot_001`) -> artifacts."""
    stages_ns: Mapping[str, Mapping[str, I64]] = field(default_factory=dict)
    """Node name -> stage -> durations [ns]."""
    bytes_up: Mapping[str, int] = field(default_factory=dict)
    """Robot -> bytes it sent on the radio plane."""
    bytes_down: Mapping[str, int] = field(default_factory=dict)
    events: tuple[Mapping[str, Any], ...] = ()
    """Ordered by stamp_ns."""

    @property
    def robots(self) -> tuple[str, ...]:
        """Ids of the run's robots."""
        return tuple(keys.robot_id(i + 1) for i in range(self.run.robots))

    @property
    def gone(self) -> tuple[str, ...]:
        """Robots that left before the end, or never came: the run ended without waiting for them."""
        return tuple(keys.robot_id(int(number)) for number in self.of(keys.ORCHESTRATOR).get("gone", ()))

    @property
    def revoked(self) -> tuple[str, ...]:
        """Robots whose registers were taken out of the map, during the run or after it."""
        return tuple(keys.robot_id(int(number)) for number in self.of(keys.MANAGER).get("revoked", ()))

    @property
    def staying(self) -> tuple[str, ...]:
        """Robots that were there at the end, and in the map."""
        return tuple(robot for robot in self.robots if robot not in (*self.gone, *self.revoked))

    @property
    def glrm_grid(self) -> Grid:
        """The scenario's GLRM grid."""
        return self.scenario.grid.grid

    def phase_began_s(self, name: str) -> float | None:
        """Simulation time at which a phase of the run began, None if it never did."""
        arrays = self.of(keys.ORCHESTRATOR)
        began = dict(zip(arrays.get("phase_names", ()), arrays.get("phase_stamps_ns", ()), strict=True))
        return float(began[name]) / 1e9 if name in began else None

    def waypoints_visited(self) -> int | None:
        """How many of the patrol's waypoints were visited by anybody."""
        visited = self.of(keys.ORCHESTRATOR).get("visited_ns")
        return None if visited is None else int((visited >= 0).sum())

    def of(self, service: str, robot: str | None = None) -> Arrays:
        """Artifacts of a node, empty where it left none."""
        return self.nodes.get(keys.node(service, robot), EMPTY)

    def missing(self) -> tuple[str, ...]:
        """Nodes that should have left artifacts and did not."""
        wanted = [keys.node(s) for s in (keys.WORLD, keys.MANAGER, keys.ORCHESTRATOR)]
        wanted += [keys.node(s, r) for r in self.robots for s in keys.ROBOT_SERVICES]
        return tuple(name for name in wanted if name not in self.nodes)

    def hrm(self, robot: str) -> CellMap | None:
        """A robot's last HRM (evidence over the prior), None where it left none."""
        arrays = self.of(keys.MAPPING, robot)
        if any(f"hrm_{name}" not in arrays for name in BASIC_LAYERS):
            return None
        height = arrays["hrm_height"]
        x0, y0 = (float(v) for v in arrays["hrm_origin_m"])
        shape = (int(height.shape[0]), int(height.shape[1]))
        blank = CellMap.unknown(Grid((x0, y0), float(arrays["hrm_cell_m"]), shape))
        mapped = {name: arrays[f"hrm_{name}"].astype(np.float32) for name in MAPPED_LAYERS if f"hrm_{name}" in arrays}
        return CellMap(blank.grid, {**blank.by_name, **mapped})

    def hrms(self) -> Iterator[tuple[str, CellMap]]:
        """Pairs (robot, HRM) of those that left one."""
        for robot in self.robots:
            hrm = self.hrm(robot)
            if hrm is not None:
                yield robot, hrm

    def initial_hrm_height(self, robot: str) -> tuple[Grid, Layer] | None:
        """Grid and visible surface [m] of a robot's HRM before its first scan."""
        arrays = self.of(keys.MAPPING, robot)
        if "initial_hrm_height" not in arrays:
            return None
        height: Layer = arrays["initial_hrm_height"].astype(np.float32)
        x0, y0 = (float(v) for v in arrays["initial_hrm_origin_m"])
        return Grid((x0, y0), float(arrays["hrm_cell_m"]), (int(height.shape[0]), int(height.shape[1]))), height


def read_parts(out: Path) -> RunParts:
    """What a run left in its folder; raises FolderError when the run or its scenario cannot be read."""
    up, down = _bytes(out)
    return RunParts(
        scenario=read_scenario(out),
        run=RunInfo.read(out),
        nodes=dict(_node_arrays(out)),
        stages_ns=dict(_stages(out)),
        bytes_up=up,
        bytes_down=down,
        events=read_events(out),
    )


def read_scenario(out: Path) -> Scenario:
    """The resolved scenario of a run folder; raises FolderError where it cannot be read, or is of another version."""
    try:
        return Scenario.model_validate_json(run_folder.read_text(out, run_folder.SCENARIO))
    except ValidationError as error:
        first = error.errors()[0]
        place = ".".join(str(part) for part in first["loc"])
        raise run_folder.FolderError(
            f"{out / run_folder.SCENARIO}: {place}: {first['msg']}: the run is of another version of this program"
        ) from None


def _node_arrays(out: Path) -> Iterator[tuple[str, Arrays]]:
    for path in sorted(out.glob(run_folder.node_file("*"))):
        name = run_folder.node_of(path)
        if name is not None:
            yield name, run_folder.read_arrays(path)


def _stages(out: Path) -> Iterator[tuple[str, dict[str, I64]]]:
    for path in sorted(out.glob(run_folder.stages_file("*"))):
        name = run_folder.node_of(path)
        if name is not None:
            yield name, {s: np.array(ns, np.int64) for s, ns in json.loads(path.read_text()).items()}


def _bytes(out: Path) -> tuple[dict[str, int], dict[str, int]]:
    total: dict[str, Counter[str]] = {"up": Counter(), "down": Counter()}
    for path in sorted(out.glob(run_folder.bytes_file("*"))):
        counted: Mapping[str, Mapping[str, int]] = json.loads(path.read_text())
        for way, sums in total.items():
            sums.update(counted.get(way, {}))
    return dict(total["up"]), dict(total["down"])


def read_events(out: Path) -> tuple[Mapping[str, Any], ...]:
    """What the services of a run have noted so far, ordered by stamp_ns."""
    return _ordered(line for path in _event_files(out) for line in path.read_bytes().splitlines())


class EventTail:
    """What the services of a run note while it goes on: each event once, however often one asks."""

    def __init__(self, out: Path) -> None:
        self._out, self._read = out, Counter[Path]()

    def news(self) -> tuple[Mapping[str, Any], ...]:
        """What was noted since it was asked last, ordered by stamp_ns; a line that is not complete yet comes later."""
        return _ordered(line for path in _event_files(self._out) for line in self._lines(path))

    def _lines(self, path: Path) -> list[bytes]:
        with path.open("rb") as stream:
            stream.seek(self._read[path])
            complete, end, _ = stream.read().rpartition(b"\n")
        self._read[path] += len(complete) + len(end)
        return complete.splitlines()


def _event_files(out: Path) -> list[Path]:
    return sorted(out.glob(run_folder.events_file("*")))


def _ordered(lines: Iterable[bytes]) -> tuple[Mapping[str, Any], ...]:
    return tuple(sorted((e for e in map(_event, lines) if e is not None), key=lambda e: int(e.get("stamp_ns", 0))))


def _event(line: bytes) -> Mapping[str, Any] | None:
    """One event; None for a line cut short by a service's death."""
    try:
        event = json.loads(line)
    except ValueError:  # no JSON, or no text
        return None
    return event if isinstance(event, dict) else None
