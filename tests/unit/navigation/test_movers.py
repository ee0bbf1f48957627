"""What moves is followed from map to map, and yielded to: velocities, foretold courses, and whole drives."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from orograph.messages import OccupancyGrid
from orograph.navigation.movers import Movers, appeared, arrival_s, clusters
from orograph.navigation.planner_kernels import MET_AFTER_S, MET_BEFORE_S, first_met
from unicycle.world import UnicycleWorld, scenario_of

SIDE = 120


def a_map(stamp_s, boxes=(), x0=0.0, y0=0.0):
    x, y = x0 + (np.arange(SIDE) + 0.5) * 0.5, y0 + (np.arange(SIDE) + 0.5) * 0.5
    occupation = np.zeros((SIDE, SIDE), np.uint8)
    for a, b, c, d in boxes:
        occupation[((y > b) & (y < d))[:, None] & ((x > a) & (x < c))[None]] = 254
    return OccupancyGrid(round(stamp_s * 1e9), x0, y0, 0.5, False, occupation)


def car(x, y):
    return (x - 2, y - 1, x + 2, y + 1)


def followed(course, until_s=4.0, static=()):
    """Movers after maps every 0.4 s of a car on `course(t)` beside boxes that stand."""
    movers, times = Movers(), np.arange(0.0, until_s, 0.4)
    maps = [a_map(t, [*static, car(*course(t))]) for t in times]
    for k in range(1, len(maps)):
        movers.take(maps[k], maps[max(0, k - 2)])
    return movers


def test_what_is_blocked_only_now_is_found_though_the_map_has_rolled():
    stays, comes = (10, 10, 11, 12), (20, 15, 21, 16)
    came = appeared(a_map(1, [stays, comes], x0=5.0, y0=-5.0), a_map(0, [stays]))
    (group,) = clusters(came)
    assert sorted(map(tuple, group)) == [(20.25, 15.25), (20.25, 15.75), (20.75, 15.25), (20.75, 15.75)]


def test_what_was_unknown_has_not_come():
    old = a_map(0)
    old.occupation[:] = 255
    assert clusters(appeared(a_map(1, [(20, 15, 21, 16)]), old)) == []


@settings(max_examples=15, deadline=None)
@given(st.floats(1.5, 8.0), st.floats(-math.pi, math.pi))
def test_a_cars_velocity_is_known_and_walls_do_not_move(speed, heading):
    vx, vy = speed * math.cos(heading), speed * math.sin(heading)
    movers = followed(lambda t: (30 + vx * (t - 2), 30 + vy * (t - 2)), static=[(0, 5, 60, 6)])
    (mover,) = movers.sure
    assert np.hypot(*(mover.velocity_mps - (vx, vy))) < 0.8 + 0.1 * speed, "a cell is 0.5 m, a map 0.4 s"


def test_a_car_in_a_bend_is_foretold_to_turn_on():
    radius, speed = 5.0, 5.0
    course = lambda t: (30 + radius * math.sin(speed / radius * t), 30 - radius * math.cos(speed / radius * t))  # noqa: E731
    (mover,) = followed(course, until_s=2.4).sure
    assert mover.turn_radps == pytest.approx(speed / radius, abs=0.4)
    straight = mover.at_m + mover.velocity_mps
    true = np.array(course(mover.stamp_ns * 1e-9 + 1.0))
    foretold = mover.at_m + mover.moved_m(np.arange(0.0, 1.01, 0.2))[-1]
    assert np.hypot(*(foretold - true)) < 0.7 * np.hypot(*(straight - true))


def test_arrival_is_that_of_a_robot_that_speeds_up():
    v, x, dt = 0.5, 0.0, 1e-3
    arc = np.arange(0.0, 20.0, 0.5)
    times = []
    for k in range(20_000):
        times += [k * dt] * int((arc[len(times) :] <= x).sum())
        v = min(2.5, v + 1.2 * dt)
        x += v * dt
    np.testing.assert_allclose(arrival_s(arc, 0.5), times, atol=0.01)


@settings(max_examples=40, deadline=None)
@given(st.integers(0, 2**32 - 1))
def test_the_first_meeting_is_what_a_look_at_every_instant_finds(seed):
    rng = np.random.default_rng(seed)
    path = np.column_stack([np.arange(0.0, 12.0, 0.5), np.zeros(24)])
    arrival, times = np.sort(rng.random(24)) * 6, np.arange(0.0, 5.0, 0.5)
    cells = rng.random((4, 2)) * 16 - (2, 8)
    moved, reach = times[:, None] * (rng.random(2) * 6 - 3), 1.0 + rng.random(10)
    near = np.hypot(*(path[:, None, None] - cells[None, :, None] - moved[None, None]).transpose(3, 0, 1, 2)) < reach
    comes = near.any(axis=1)
    when = (times[None] - MET_BEFORE_S <= arrival[:, None]) & (arrival[:, None] <= times[None] + MET_AFTER_S)
    met = np.flatnonzero((comes & when).any(axis=1))
    swept = np.flatnonzero(comes.any(axis=1))
    safe = np.setdiff1d(np.arange(met[0] if len(met) else 24), swept)
    expected = [int(found[k]) if len(found) else -1 for found, k in ((met, 0), (safe, -1), (swept, 0))]
    assert list(first_met(path, arrival, cells, times, moved, reach)) == expected


@pytest.mark.parametrize(("speed", "phase"), [(3, 2), (3, 4), (5, 2), (8, 3)])
def test_a_car_that_crosses_and_never_yields_is_not_hit(speed, phase):
    def mover(t):
        y = speed * (t - phase) - 32
        return (39, y - 2, 41, y + 2) if y < 60 else None

    world = UnicycleWorld(scenario_of([(70, 12)], start=(6, 12, 0)), mover=mover)
    world.run(60, lambda w: "done" in w.kinds())
    assert world.hits == [] and world.notes[-1][1] == "done"
