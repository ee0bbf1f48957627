"""Recorded scans to one map, without services: read, place, map, and keep every cell."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field

import numpy as np

from orograph.arrays import F64
from orograph.errors import InputError
from orograph.grid import Grid
from orograph.importers.scans import ScanError, Scans
from orograph.importers.scans.posed import Placed, PosedScans
from orograph.layers import CellMap
from orograph.mapping import RobotMapper
from orograph.rules import Rules

BLOCK = 10
"""Fine cells on a side of a block that is kept or brought back as one."""
CELLS_MAX = 36_000_000
"""Of a map: its layers take 1.6 GB."""


@dataclass(frozen=True)
class MapRules:
    """How recordings are mapped."""

    cell_m: float
    range_min_m: float
    range_max_m: float
    rules: Rules


@dataclass
class Told:
    """How far the work is."""

    scans: int = 0
    scans_in_all: int = 0
    without_pose: int = 0
    points: int = 0
    self_box: int = 0
    began_s: float = field(default_factory=time.monotonic)


@dataclass(frozen=True, eq=False)
class Mapped:
    """A finished map, and what happened on the way."""

    cells: CellMap
    told: Told
    dropped: dict[str, int]
    path_m: F64
    """Where the sensor was (scans, 3); empty for points of no sensor."""
    recorded_s: float
    clock_restarts: int
    took_s: float


class Recorder:
    """Maps one placed scan after the other; the map frame is that of their poses."""

    def __init__(self, how: MapRules) -> None:
        self._how = how
        self._mapper: RobotMapper | None = None
        self._path: list[F64] = []
        self._stamps_ns: list[int] = []
        self.told = Told()

    def add(self, scan: Placed) -> None:
        """Map a scan; raises InputError where the map would grow too large."""
        self._counted(scan)
        self._path.append(scan.position_m)
        self._stamps_ns.append(scan.stamp_ns)
        mapper = self._mapper_at(scan.position_m)
        mapper.step(scan.points, scan.ranges_m, scan.position_m, scan.stamp_ns)
        self._bounded(mapper)

    def add_points(self, scan: Placed) -> None:
        """Map points (n, 3) of no known sensor, one window of the map after the other."""
        self._counted(scan)
        points = scan.points[np.isfinite(scan.points).all(axis=1)]
        side_m = (self._blocks - 2) * BLOCK * self._how.cell_m
        for tile in _tiles(points, side_m):
            middle = (np.floor(tile[0, :2] / side_m) + 0.5) * side_m
            mapper = self._mapper_at(middle)
            mapper.step(tile, np.full(len(tile), self._how.range_min_m), middle, scan.stamp_ns)
            self._bounded(mapper)

    def finished(self) -> Mapped:
        """The map; raises InputError where there was nothing to map."""
        if self._mapper is None:
            raise InputError("none of the scans could be placed: the poses are of another time")
        stamps = self._stamps_ns or [0]
        dropped = {"self_box": self.told.self_box, **self._mapper.dropped}
        return Mapped(
            self._mapper.fine(), self.told, {why: n for why, n in dropped.items() if n},
            np.array(self._path).reshape(-1, 3), (max(stamps) - min(stamps)) / 1e9, self._mapper.clock_restarts,
            time.monotonic() - self.told.began_s,
        )  # fmt: skip

    @property
    def _blocks(self) -> int:
        """On a side of the window, whose middle is within one block of the sensor."""
        return 2 * math.ceil(self._how.range_max_m / (BLOCK * self._how.cell_m)) + 2

    def _counted(self, scan: Placed) -> None:
        self.told.points += len(scan.points) + scan.self_box
        self.told.self_box += scan.self_box

    def _mapper_at(self, position_m: F64) -> RobotMapper:
        """The mapper; its cells' edges are whole multiples of the block's side wherever on Earth the first scan is."""
        if self._mapper is None:
            how, block_m = self._how, BLOCK * self._how.cell_m
            x_m, y_m = (np.floor(position_m[:2] / block_m) * block_m).tolist()
            self._mapper = RobotMapper(
                Grid((x_m, y_m), block_m, (1, 1)), self._blocks * BLOCK, BLOCK, how.rules, how.range_max_m,
                range_min_m=how.range_min_m, keep_fine=True,
            )  # fmt: skip
        return self._mapper

    def _bounded(self, mapper: RobotMapper) -> None:
        rows, cols = mapper.fine_blocks
        if rows * cols * BLOCK**2 > CELLS_MAX:
            wide_m, high_m = (n * BLOCK * self._how.cell_m for n in (cols, rows))
            least_m = math.sqrt(wide_m * high_m / CELLS_MAX)
            raise InputError(
                f"the map would span {wide_m / 1e3:.1f} x {high_m / 1e3:.1f} km: more than {CELLS_MAX // 10**6} "
                f"million cells of {self._how.cell_m:g} m; give --cell {math.ceil(least_m * 10) / 10:g}, or look "
                "whether poses jump"
            )


def map_recordings(
    recordings: Sequence[tuple[str, Scans, PosedScans]], how: MapRules, on_scan: Callable[[Told], None]
) -> Mapped:
    """Map recordings (name, scans, the same with poses) one after the other into one map; raises InputError."""
    recorder = Recorder(how)
    recorder.told.scans_in_all = sum(len(scans) for _, scans, _ in recordings)
    for name, scans, posed in recordings:
        for scan in _placed(scans, posed):
            try:
                if scan is None:
                    recorder.told.without_pose += 1
                elif scans.in_map:
                    recorder.add_points(scan)
                else:
                    recorder.add(scan)
            except ValueError as error:
                raise ScanError(f"{name}: scan {recorder.told.scans + 1}: {error}") from None
            recorder.told.scans += 1
            on_scan(recorder.told)
    return recorder.finished()


def _placed(scans: Scans, posed: PosedScans) -> Iterator[Placed | None]:
    for i in range(len(scans)):
        if scans.in_map:
            scan = scans[i]
            yield Placed(scan.points, np.ones(len(scan.points)), np.zeros(3), scan.stamp_ns or 0, 0)
        else:
            yield posed[i]


def _tiles(points: F64, side_m: float) -> Iterator[F64]:
    """Points (n, 3) by squares of this side, each (k, 3) in the order they came in."""
    if not len(points):
        return
    squares = np.floor(points[:, :2] / side_m).astype(np.int64)
    _, tile_of_point = np.unique(squares, axis=0, return_inverse=True)
    order = np.argsort(tile_of_point.reshape(-1), kind="stable")
    yield from np.split(points[order], np.cumsum(np.bincount(tile_of_point.reshape(-1)))[:-1])
