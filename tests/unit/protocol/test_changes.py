"""What counts as a change of a cell's surface: by hand, over a restart, and a car that parks in a made-up street."""

from __future__ import annotations

import numpy as np
import pytest
from bench.map_street import PARKED, PERIOD_NS, STREET, views
from bench.map_street import Course as StreetCourse
from made_up.cells import records
from orograph.geometry import laser_position_m, ray_directions
from orograph.mapping import RobotMapper
from orograph.messages import REGISTER, UPDATE, Batch, Hello
from orograph.protocol.changes import OPEN, STANDS, UNSURE, surface_of
from orograph.protocol.manager import ManagerSync
from orograph.protocol.store import MemoryStore
from orograph.rules import SURFACE
from orograph.scene.prior import given_layers, prior_records

SHAPE, SIZE = (5, 9), 45
ROBOT, OTHER = "robot_001", "robot_002"
ROAD = {"confidence": 100, "free_share": 150}
CAR = {"confidence": 90, "confidence_top": 200, "height_top": 1500, "wall_share": 12, "free_share": 140}
HOUSE = {"confidence": 50, "confidence_top": 250, "height_top": 9000, "wall_share": 60, "free_share": 40}
SLIVER = {**HOUSE, "wall_share": 4, "free_share": 180}


class Played:
    """A manager of two robots over an empty plain, and what it told of changes: (cell, since [s], from, to)."""

    def __init__(self) -> None:
        self.store, self.now_s, self.told, self.seq = MemoryStore(), 0.0, [], 0
        self.restart()
        self.step(0.1, (ROBOT, Hello(b"a" * 16)), (OTHER, Hello(b"b" * 16)))

    def restart(self) -> None:
        prior = records(UPDATE, *({"cell": i, "confidence": 32, "free_share": 200} for i in range(SIZE)))
        self.sync = ManagerSync(SHAPE, prior, SURFACE, self.store, [ROBOT, OTHER])

    def step(self, seconds: float, *inbox) -> None:
        def note(kind, fields) -> None:
            if kind == "changed":
                self.told.append(tuple(fields.values()))

        self.now_s += seconds
        self.sync.step(round(self.now_s * 1e9), inbox, lambda *message: None, note)

    def sees(self, cell: int, surface: dict[str, int], by: str = ROBOT, for_s: float = 7.0) -> None:
        self.seq += 1
        record = records(UPDATE, {**surface, "cell": cell, "seq": self.seq, "tick": round(self.now_s * 1e3)})
        self.step(0, (by, Batch(self.sync.epoch(by), record)))
        for _ in range(round(for_s / 0.5)):
            self.step(0.5)


@pytest.mark.parametrize(
    ("cell", "surface"), [(ROAD, OPEN), (CAR, STANDS), (HOUSE, STANDS), (SLIVER, UNSURE), ({"confidence": 9}, UNSURE)]
)
def test_what_a_cell_says(cell, surface) -> None:
    assert surface_of(records(UPDATE, cell)).tolist() == [surface]


def test_what_parks_and_leaves_is_told_once_each_whoever_saw_it() -> None:
    played = Played()
    played.sees(20, ROAD)
    played.sees(20, CAR, by=OTHER)
    assert played.told == [(20, 7100, None, 1.5)]
    played.sees(20, {**CAR, "confidence": 91}, by=OTHER)
    played.sees(20, {**ROAD, "confidence": 250}, by=OTHER)
    assert played.told[1:] == [(20, 21100, 1.5, None)] and played.sync.changed_ms[20] == 21100
    assert (np.delete(played.sync.changed_ms, 20) == -1).all() and played.sync.telemetry()["surface_changes"] == 2


def test_a_first_look_a_passing_car_and_a_better_look_are_no_changes() -> None:
    played = Played()
    played.sees(20, CAR)
    played.sees(30, ROAD)
    played.sees(30, CAR, for_s=3)
    played.sees(30, ROAD)
    played.sees(20, {**CAR, "height_top": 2200})
    assert played.told == []


def test_a_wall_on_the_edge_of_two_cells_is_no_change_but_a_car_beside_a_house_is() -> None:
    played = Played()
    for cell, surface in ((20, HOUSE), (21, ROAD), (11, ROAD), (13, ROAD)):
        played.sees(cell, surface, for_s=10)
    played.sees(20, {**HOUSE, "confidence": 60}, for_s=30)
    played.sees(21, {**HOUSE, "height_top": 8500})
    played.sees(11, CAR)
    assert [cell for cell, *_ in played.told] == [11]
    played.sees(21, ROAD, for_s=40)
    assert [cell for cell, *_ in played.told] == [11], "the house is still there"


def test_a_house_that_is_pulled_down_goes_from_all_its_cells() -> None:
    played = Played()
    for cell in (20, 21):
        played.sees(cell, HOUSE)
    played.sees(20, ROAD, for_s=10)
    played.sees(21, ROAD, for_s=10)
    assert sorted((cell, top, now) for cell, _, top, now in played.told) == [(20, 9.0, None), (21, 9.0, None)]


def test_a_restart_forgets_no_surface_and_tells_nothing_twice() -> None:
    played = Played()
    played.sees(20, ROAD)
    played.sees(20, CAR, for_s=2)
    played.restart()
    for _ in range(14):
        played.step(0.5)
    assert [(cell, top, now) for cell, _, top, now in played.told] == [(20, None, 1.5)]
    before = played.sync.changed_ms.tolist()
    played.restart()
    for _ in range(14):
        played.step(0.5)
    assert len(played.told) == 1 and played.sync.changed_ms.tolist() == before


def test_what_a_revoked_robot_saw_is_neither_a_change_nor_known() -> None:
    played = Played()
    played.sees(20, ROAD)
    played.sees(20, CAR, by=OTHER)
    played.sync.revoke(OTHER)
    for _ in range(14):
        played.step(0.5)
    assert len(played.told) == 1 and played.sync.changed_ms[20] == -1
    played.sees(20, CAR)
    assert len(played.told) == 1, "a first look"


def test_a_full_disk_only_delays_it() -> None:
    played = Played()
    played.sees(20, ROAD)
    played.sees(20, CAR, for_s=4)
    played.store.full = True
    for _ in range(4):
        played.step(0.5)
    assert played.told == []
    played.store.full = False
    played.step(0.5)
    assert [cell for cell, *_ in played.told] == [20]


def test_a_car_that_parks_and_leaves_in_a_street_is_told_within_seconds(monkeypatch) -> None:
    """A standing robot's laser, mapping, registers and manager; the car stands from 8 s to 18 s."""
    monkeypatch.setattr("bench.map_street.BEGIN_S", 8.0)
    monkeypatch.setattr("bench.map_street.PRESENT_S", 10.0)
    monkeypatch.setattr("bench.map_street.AFTER_S", 9.0)
    grid, directions = STREET.grid.grid, ray_directions(STREET.laser)
    mapper = RobotMapper(grid, STREET.hrm.cells, STREET.hrm.per_glrm_cell, SURFACE, STREET.laser.range_max_m,
                         STREET.robot.slope_max, given_layers(STREET))  # fmt: skip
    manager = ManagerSync(grid.shape, prior_records(STREET), SURFACE, MemoryStore(), [ROBOT])
    held, told, seq = np.zeros(grid.size, REGISTER), [], 0

    def step(now_ns, *inbox) -> None:
        note = lambda kind, fields: told.append((now_ns / 1e9, *fields.values())) if kind == "changed" else None  # noqa: E731
        manager.step(now_ns, inbox, lambda *message: None, note)

    step(0, (ROBOT, Hello(b"a" * 16)))
    for view in views(StreetCourse("car", "standing"), 1):
        now_ns = round(view.stamp_s * 1e9)
        eye_m = laser_position_m(STREET.laser, view.R_map_robot, view.position_m)
        news = mapper.step_scan(view.ranges, directions, view.R_map_robot, eye_m, now_ns, held)
        news["seq"] = seq + 1 + np.arange(len(news))
        seq += len(news)
        for name in UPDATE.names or ():
            held[name][news["cell"]] = news[name]
        parts = [(ROBOT, Batch(1, news[i : i + 256])) for i in range(0, len(news), 256)]
        step(now_ns + PERIOD_NS // 2, *parts)
    car = grid.row_col(PARKED.x_m, PARKED.y_m)
    assert car is not None and {cell for _, cell, *_ in told} <= {
        (car[0] + i) * grid.cols + car[1] + j for i in (-1, 0, 1) for j in (-1, 0, 1)
    }
    came = [(at_s, since_ms / 1e3) for at_s, _, since_ms, before, now in told if before is None]
    went = [(at_s, since_ms / 1e3) for at_s, _, since_ms, before, now in told if now is None]
    assert came and went and all(8 <= since_s <= 9 and at_s <= 14.5 for at_s, since_s in came)
    assert all(18 <= since_s <= 20 and at_s <= 26 for at_s, since_s in went)
