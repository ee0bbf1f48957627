"""The patrol split against brute force over every division and order."""

from __future__ import annotations

import itertools
import json
import subprocess
import sys

import numpy as np
import pytest
from orograph.mission import split
from orograph.mission.distances import UNREACHABLE_M
from orograph.mission.split import longest_m, split_patrol

WITHIN = 1.1
"""The promise: at most a tenth longer than the optimum."""


def plane(seed: int, robots: int, waypoints: int) -> np.ndarray:
    """Straight-line distances of random places in a square of 500 m."""
    places = np.random.default_rng(seed).uniform(0, 500, (robots + waypoints, 2))
    return np.linalg.norm(places[:, None] - places[None], axis=2)


def shortest_open_tour(distance_m: np.ndarray, start: int, stops: tuple[int, ...]) -> float:
    """Length of the best order, all orders tried."""
    best = 0.0 if not stops else float("inf")
    for order in itertools.permutations(stops):
        length = sum(distance_m[a, b] for a, b in itertools.pairwise((start, *order)))
        best = min(best, length)
    return best


def optimum(distance_m: np.ndarray, robots: int) -> float:
    """The shortest longest tour, all divisions tried."""
    waypoints = len(distance_m) - robots
    tour = {
        (r, stops): shortest_open_tour(distance_m, r, tuple(robots + w for w in stops))
        for r in range(robots)
        for k in range(waypoints + 1)
        for stops in itertools.combinations(range(waypoints), k)
    }
    divisions = itertools.product(range(robots), repeat=waypoints)
    return min(
        max(tour[r, tuple(w for w in range(waypoints) if taker[w] == r)] for r in range(robots)) for taker in divisions
    )


@pytest.mark.parametrize("robots", [1, 2, 3])
@pytest.mark.parametrize("seed", range(6))
def test_longest_tour_is_near_the_optimum(robots: int, seed: int) -> None:
    distance_m = plane(seed, robots, 6)
    tours = split_patrol(robots, distance_m)
    assert longest_m(robots, distance_m, tours) <= WITHIN * optimum(distance_m, robots), (robots, seed, tours)


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize(("robots", "waypoints"), [(1, 0), (1, 1), (4, 2), (5, 11), (2, 40)])
def test_every_waypoint_is_dealt_once(robots: int, waypoints: int, seed: int) -> None:
    tours = split_patrol(robots, plane(seed, robots, waypoints))
    assert len(tours) == robots
    assert sorted(w for tour in tours for w in tour) == list(range(waypoints)), (seed, tours)


def test_two_robots_at_the_ends_of_a_street_meet_in_its_middle() -> None:
    along_m = np.array([0.0, 70.0, 10.0, 20.0, 30.0, 40.0, 50.0, 60.0])  # starts at 0 and 70, then six waypoints
    tours = split_patrol(2, np.abs(along_m[:, None] - along_m[None]))
    assert tours == [[0, 1, 2], [5, 4, 3]]


def test_no_longer_than_a_known_good_tour_of_ten_robots() -> None:
    # Sixty waypoints on ten parallel streets of 60 m, a robot at the foot of each: 60 m each, and no more.
    places = [(1000.0 * r, 0.0) for r in range(10)] + [(1000.0 * (i % 10), 10.0 * (i // 10 + 1)) for i in range(60)]
    xy = np.array(places)
    distance_m = np.linalg.norm(xy[:, None] - xy[None], axis=2)
    assert longest_m(10, distance_m, split_patrol(10, distance_m)) == pytest.approx(60.0)


def test_barred_waypoints_go_to_others_unless_all_are_barred() -> None:
    along_m = np.array([0.0, 100.0, 1.0, 2.0, 3.0])
    distance_m = np.abs(along_m[:, None] - along_m[None])
    tours = split_patrol(2, distance_m, [{0, 1}, {1}])
    assert 0 in tours[1] and sorted(tours[0] + tours[1]) == [0, 1, 2]


def test_an_unreachable_waypoint_ends_the_shortest_tour_and_spoils_no_other() -> None:
    along_m = np.array([0.0, 70.0, 10.0, 20.0, 30.0, 40.0, 50.0])
    distance_m = np.abs(along_m[:, None] - along_m[None])
    distance_m[3], distance_m[:, 3] = UNREACHABLE_M, UNREACHABLE_M  # waypoint 1 is walled in
    distance_m[3, 3] = 0.0
    tours = split_patrol(2, distance_m)
    assert [w for w in tours[0] if w != 1] == [0, 2] and [w for w in tours[1] if w != 1] == [4, 3]
    assert 1 in (tours[0][-1], tours[1][-1])


def test_a_waypoint_behind_a_wall_goes_to_the_robot_on_its_side() -> None:
    distance_m = np.full((4, 4), 5.0) - 5.0 * np.eye(4)
    for a, b in [(0, 1), (0, 3), (1, 2), (2, 3)]:  # robot 0 with waypoint 0, robot 1 with waypoint 1
        distance_m[a, b] = distance_m[b, a] = UNREACHABLE_M
    assert split_patrol(2, distance_m) == [[0], [1]]


@pytest.mark.parametrize(("robots", "waypoints"), [(1, 101), (7, 160), (60, 600)])
def test_a_patrol_too_large_to_search_is_dealt_out_in_bounded_work(robots, waypoints, monkeypatch) -> None:
    searched: list[int] = []
    search = split._search
    monkeypatch.setattr(split, "_search", lambda p, r, w, *how: searched.append(len(w)) or search(p, r, w, *how))
    monkeypatch.setattr(split, "WORK_MAX", 200_000)
    distance_m = plane(3, robots, waypoints)
    tours = split_patrol(robots, distance_m)
    assert sorted(w for tour in tours for w in tour) == list(range(waypoints))
    assert sum(w**3 for w in searched) <= 200_000 + 9 * max(searched, default=0) ** 3, "one more at most"
    # All tours together are seldom below 0.7124 sqrt(waypoints x area) (Beardwood, Halton, Hammersley).
    even_m = 0.7124 * (waypoints * 500.0**2) ** 0.5 / robots
    assert longest_m(robots, distance_m, tours) < 1.6 * even_m


def test_work_is_bounded_below_that_size_too(monkeypatch) -> None:
    searched: list[int] = []
    search = split._search
    monkeypatch.setattr(split, "_search", lambda p, r, w, *how: searched.append(len(w)) or search(p, r, w, *how))
    monkeypatch.setattr(split, "WORK_MAX", 0)
    split_patrol(12, plane(4, 12, 30))
    assert searched == [30] * 9, "the first search, by every weight and first tour, and none to improve it"


def test_large_patrols_keep_what_is_barred_and_what_a_wall_hides_from_a_robot(monkeypatch) -> None:
    monkeypatch.setattr(split, "WORK_MAX", 0)
    distance_m = plane(5, 3, 150)
    distance_m[0, 3:80] = distance_m[3:80, 0] = UNREACHABLE_M
    tours = split_patrol(3, distance_m, [set(), set(range(80, 120)), set()])
    assert sorted(w for tour in tours for w in tour) == list(range(150))
    assert min(tours[0]) >= 77 and not set(tours[1]) & set(range(80, 120))


def test_another_process_splits_alike() -> None:
    program = (
        "import json, sys, numpy as np\n"
        "from orograph.mission.split import split_patrol\n"
        "print(json.dumps(split_patrol(4, np.array(json.load(sys.stdin)))))\n"
    )
    distance_m = plane(9, 4, 25)
    there = subprocess.run(
        [sys.executable, "-c", program], input=json.dumps(distance_m.tolist()), capture_output=True, text=True,
        check=True, env={"PYTHONHASHSEED": "77"},
    )  # fmt: skip
    assert json.loads(there.stdout) == split_patrol(4, distance_m)
