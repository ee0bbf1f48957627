"""Which body touches a robot, how pushes become contacts, and that physics feels them."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import pytest
from orograph.scenario import Building, Scenario, Start, TerrainSpec, Vehicle, Wave
from orograph.world import World
from orograph.world.contacts import APART_NS, Contact, ContactBook, Outline, touched

Make = Callable[..., Scenario]
FRAME_NS = 100_000_000
ROBOT = "robot_001"
HERE = Outline(10.0, 10.0, 0.0, 0.7, 0.6)
PUSH = Contact(ROBOT, "vehicle_000", 1.0, 2.0, 0, 0, 500.0, 0.1)


@pytest.mark.parametrize(
    ("other", "touches"),
    [
        (Outline(12.5, 10.0, 0.0, 4.2, 1.8), True),  # 5 cm before its nose
        (Outline(12.9, 10.0, 0.0, 4.2, 1.8), False),
        (Outline(10.0, 12.4, math.pi / 2, 4.2, 1.8), True),  # turned: 0 m beside it
        (Outline(10.0, 12.4, 0.0, 4.2, 1.8), False),
        (Outline(10.2, 10.1, 1.0, 4.2, 1.8), True),  # inside
        (Outline(11.1, 11.0, math.pi / 4, 2.0, 1.8), True),  # with its nose at a corner
    ],
)
def test_what_touches(other: Outline, touches: bool) -> None:
    assert touched(HERE, {"it": other}) == ("it" if touches else "building")


def test_the_nearest_touches_and_alone_it_is_a_building() -> None:
    near, nearer = Outline(12.52, 10, 0, 4.2, 1.8), Outline(9.3, 10, 0, 0.7, 0.6)
    assert touched(HERE, {"near": near, "nearer": nearer}) == "nearer"
    assert touched(HERE, {}) == "building"


def test_pushes_with_little_between_them_are_one_contact() -> None:
    book = ContactBook()
    assert book.push(PUSH)
    assert not book.push(replace(PUSH, x_m=9.0, since_ns=FRAME_NS, last_ns=FRAME_NS, newtons=900.0))
    assert book.push(replace(PUSH, body="building", last_ns=FRAME_NS)), "another body, another contact"
    assert not list(book.over(FRAME_NS + APART_NS - 1))
    first, second = book.over(FRAME_NS + APART_NS)
    assert first == replace(PUSH, last_ns=FRAME_NS, newtons=900.0, seconds=0.2)
    assert second.body == "building"
    assert not list(book.over(10 * APART_NS)) and book.push(PUSH)
    assert list(book.rest()) == [PUSH] and not list(book.rest())


def pushes(world: World, seconds: float, drives: dict[str, tuple[float, float]]) -> list[tuple[str, str, float]]:
    """(robot, body, newtons) of every frame with a push."""
    out = []
    for _ in range(round(seconds * 1e9 / FRAME_NS)):
        world.advance(drives, FRAME_NS)
        for robot, newtons in world.pushes().items():
            others = world.outlines()
            out.append((robot, touched(others.pop(robot), others), newtons))
    return out


def test_a_wall_pushes_back(scenario_of: Make) -> None:
    wall = Building(footprint=((54, 40), (55, 40), (55, 60), (54, 60)), height_m=3)
    found = pushes(World(scenario_of(buildings=(wall,)), (ROBOT,)), 5.0, {ROBOT: (2.5, 0.0)})
    assert {(robot, body) for robot, body, _ in found} == {(ROBOT, "building")}
    assert max(newtons for _, _, newtons in found) > 1000.0  # it comes with 2.5 m/s, 65 kg
    assert len(found) > 10, "and goes on pushing"


def test_two_robots_that_meet_push_each_other(scenario_of: Make) -> None:
    starts = (Start(x_m=50, y_m=50), Start(x_m=54, y_m=50.1, heading_deg=180))
    drives = {ROBOT: (1.5, 0.0), "robot_002": (1.5, 0.0)}
    found = pushes(World(scenario_of(starts=starts, robots=2), (ROBOT, "robot_002")), 3.0, drives)
    assert {(robot, body) for robot, body, _ in found} == {(ROBOT, "robot_002"), ("robot_002", ROBOT)}


def test_a_vehicle_that_is_run_into_is_named(scenario_of: Make) -> None:
    car = Vehicle(loop=((53, 20), (80, 20), (80, 80), (53, 80)), speed_mps=1, start_fraction=0.848)
    beside = (Start(x_m=51.4, y_m=50),)
    found = pushes(World(scenario_of(vehicles=(car,), starts=beside), (ROBOT,)), 2.0, {ROBOT: (1.5, 0.0)})
    assert found and {body for _, body, _ in found} == {"vehicle_000"}


def test_hard_driving_over_hills_is_no_contact(scenario_of: Make) -> None:
    hills = TerrainSpec(waves=(Wave(amplitude_m=1.0, wavelength_m=25, heading_deg=20),), mesh_cell_m=2.0)
    world = World(scenario_of(terrain=hills), (ROBOT,))
    found = []
    for k in range(12):
        found += pushes(world, 1.0, {ROBOT: ((3.0, -2.0, 2.5, 0.0)[k % 4], (0.0, 2.0, -1.5)[k % 3])})
    assert not found
