"""The orchestrator node with robots that merely drive straight: who visits what, through silence, death and restart."""

from __future__ import annotations

import itertools
from collections.abc import Mapping
from typing import Any

import numpy as np
import pytest
from made_up.street import Run, everything, street
from orograph import keys
from orograph.messages import (
    SECOND_NS,
    Mission,
    Phase,
    RobotStatus,
    RunEnd,
)  # fmt: skip
from orograph.mission.distances import DrivingDistances
from orograph.mission.legs import Legs
from orograph.mission.patrol import Patrol
from orograph.scenario import Scenario


def test_a_plain_mission_is_driven_flushed_and_ended() -> None:
    run = Run(street(2, 8))
    run.until(600)
    assert run.end is not None and run.end.complete and run.end.copies_equal
    assert run.visited() == everything(run)
    kept = run.node.artifacts()
    assert kept["phase_names"].tolist() == ["mapping", "flush", "end"]
    assert (kept["visited_ns"] >= 0).all() and kept["unreached"].size == 0
    assert sorted([*kept["legs_robot_001"], *kept["legs_robot_002"]]) == list(range(8))
    for waypoint, by in enumerate(kept["visited_by"]):
        assert waypoint in run.drivers[keys.robot_id(int(by))].visited
    assert [fields["name"] for _, fields in run.noted("phase")] == ["flush", "end"]


def test_orders_repeat_every_second_and_numbers_only_grow() -> None:
    run = Run(street(2, 6))
    run.until(600)
    for robot in run.robots:
        spoken = [(s, m) for s, _, to, m in run.sent if to == keys.node(keys.NAVIGATOR, robot)]
        assert all(0.9 < b - a < 1.1 for (a, _), (b, _) in itertools.pairwise(spoken))
        numbers = [m.number for _, m in spoken]
        assert numbers == sorted(numbers)
    assert {plane for _, plane, _, m in run.sent if not isinstance(m, RunEnd)} == {keys.RADIO}


def test_a_minute_of_shadow_costs_a_robot_nothing() -> None:
    run = Run(street(2, 8))
    run.until(10)
    run.drivers["robot_001"].deaf = True
    run.until(55)
    run.drivers["robot_001"].deaf = False
    run.until(600)
    assert run.end is not None and run.end.complete and not run.noted("robot-lost")
    assert run.visited() == everything(run)


def test_a_robot_silent_for_good_hands_its_legs_over() -> None:
    run = Run(street(2, 8))
    run.until(10)
    run.drivers["robot_002"].dead = True
    run.until(900)
    ((lost_s, fields),) = run.noted("robot-lost")
    assert fields["robot"] == "robot_002" and 68 <= lost_s <= 72
    assert run.visited() == everything(run)
    assert run.end is not None and not run.end.complete and not run.end.copies_equal  # its last cells never came


def test_its_services_gone_the_legs_go_sooner() -> None:
    run = Run(street(2, 8))
    run.until(10)
    run.drivers["robot_002"].dead = True
    run.node.present(["robot_001"])
    run.until(40)
    ((lost_s, _),) = run.noted("robot-lost")
    assert 23 <= lost_s <= 27


def test_a_lost_robot_that_speaks_again_is_given_work() -> None:
    run = Run(street(2, 30))
    run.until(10)
    run.drivers["robot_002"].dead = True
    run.until(80)
    taken = len(run.drivers["robot_002"].visited)
    run.drivers["robot_002"].dead = False
    run.until(900)
    assert run.noted("robot-back") and run.noted("hand-over")
    assert run.visited() == everything(run) and len(run.drivers["robot_002"].visited) > taken
    assert run.end is not None and run.end.complete


def test_what_one_robot_visited_in_the_shadow_no_other_drives_to() -> None:
    run = Run(street(2, 10))
    run.until(5)
    run.drivers["robot_002"].deaf = True
    run.until(75)  # its legs are handed over at 65 s, although it has driven them all
    assert run.noted("robot-lost")
    run.drivers["robot_002"].deaf = False
    run.until(900)
    mine, its = (set(run.drivers[r].visited) for r in run.robots)
    assert mine | its == everything(run)
    assert run.end is not None and run.end.complete
    assert len(mine & its) <= 2  # at most what it reached while nobody knew


def test_a_waypoint_given_up_goes_to_another_and_only_then_is_unreached() -> None:
    run = Run(street(2, 8))
    run.drivers["robot_001"].cannot = set(range(8))
    run.drivers["robot_002"].cannot = {3}
    run.until(900)
    assert run.visited() == everything(run) - {3}
    assert run.node.artifacts()["unreached"].tolist() == [3]
    assert run.end is not None and run.end.copies_equal and not run.end.complete
    assert run.noted("hand-over")


def test_an_idle_robot_takes_legs_of_the_longest_tour() -> None:
    run = Run(street(2, 20))
    run.drivers["robot_001"].jammed = True  # stands still without saying so
    run.until(300)
    assert any(f["robot"] == "robot_001" for _, f in run.noted("hand-over"))
    assert len(run.drivers["robot_002"].visited) > 12


def test_time_up_ends_incomplete_but_equal() -> None:
    run = Run(street(1, 8, duration_max_s=30.0))
    run.until(200)
    assert run.end is not None and not run.end.complete and run.end.copies_equal
    ((flush_s, _), (end_s, _)) = run.noted("phase")
    assert flush_s == pytest.approx(30.0) and end_s < 40


@pytest.mark.parametrize("fault", ["unflushed", "other copy"])
def test_a_flush_without_agreement_ends_after_a_minute(fault: str) -> None:
    run = Run(street(2, 2))
    if fault == "unflushed":
        run.unflushed.add("robot_002")
    else:
        run.copy_hash["robot_002"] = b"x" * 16
    run.until(600)
    ((flush_s, _), (end_s, _)) = run.noted("phase")
    assert end_s - flush_s == pytest.approx(60.0, abs=1.1)
    assert run.end is not None and not run.end.complete and not run.end.copies_equal


@pytest.mark.parametrize("restart_s", [20.35, 60.0])
def test_a_restarted_orchestrator_listens_first_and_goes_on(restart_s: float) -> None:
    run = Run(street(2, 12))
    run.until(restart_s)
    before = max(d.number for d in run.drivers.values())
    begun, known = len(run.sent), run.visited()
    run.restart()
    run.until(restart_s + 2.9)
    assert len(run.sent) == begun  # nothing is said before the robots were heard
    run.until(900)
    later = [m for _, _, _, m in run.sent[begun:] if isinstance(m, Mission)]
    assert min(m.number for m in later) > before
    assert not known & {int(w) for m in later for w in m.waypoints}
    assert run.visited() == everything(run) and run.end is not None and run.end.complete


def test_a_restart_in_the_flush_does_not_call_the_robots_back_to_mapping() -> None:
    run = Run(street(2, 4))
    run.unflushed.add("robot_001")
    while run.phase != "flush":
        run.step()
    run.until(run.now_s + 3)
    begun = len(run.sent)
    run.restart()
    run.unflushed.clear()
    run.until(run.now_s + 100)
    assert {m.name for _, _, _, m in run.sent[begun:] if isinstance(m, Phase)} == {"flush", "end"}
    assert run.end is not None and run.end.complete


def test_same_run_twice_says_the_same() -> None:
    stories = []
    for _ in range(2):
        run = Run(street(3, 15))
        run.until(12)
        run.drivers["robot_003"].deaf = True
        run.until(600)
        stories.append((run.events, [(s, to, type(m).__name__) for s, _, to, m in run.sent]))
    assert stories[0] == stories[1]


def test_telemetry_counts_what_is_left() -> None:
    run = Run(street(2, 8))
    run.step()
    assert run.node.telemetry()["waypoints_left"] == 8
    run.drivers["robot_002"].dead = True
    run.until(20)
    figures = run.node.telemetry()
    assert figures["robots_heard"] == 1 and figures["phase"] == 0 and figures["silence_robot_002_s"] > 15


def test_the_end_of_the_patrol_reaches_every_robot_as_a_newer_mission() -> None:
    run = Run(street(2, 4))
    run.until(600)
    assert all(d.flush and d.order == [] for d in run.drivers.values())


def patrol_of(scenario: Scenario) -> Patrol:
    grid, starts_m = scenario.grid.grid, [(s.x_m, s.y_m) for s in scenario.starts]
    robots = [keys.robot_id(i + 1) for i in range(len(starts_m))]
    return Patrol(robots, starts_m, Legs(scenario.patrol, DrivingDistances(np.zeros(grid.shape), grid)), 0)


def says(second: int, *, mission: int, visited: tuple[int, ...] = (), given_up: tuple[int, ...] = ()) -> RobotStatus:
    lists = (np.array(a, "<u2") for a in (visited, given_up))
    return RobotStatus(second * SECOND_NS, mission, *lists, "driving", 200.0, 50.0)


def silently(kind: str, fields: Mapping[str, Any]) -> None:
    """A note that nobody reads."""


def test_a_robot_is_told_what_others_visited_for_it_and_not_what_it_visited_itself() -> None:
    scenario = street(2, 6)
    patrol = patrol_of(scenario)
    patrol.review(1, 0, patrol.robots, silently)
    first, second, *rest = patrol.robots["robot_001"].order
    patrol.hear("robot_001", says(1, mission=1, visited=(first,)), SECOND_NS, silently)
    patrol.hear("robot_002", says(1, mission=1), SECOND_NS, silently)
    patrol.review(11, SECOND_NS, patrol.robots, silently)
    assert (patrol.robots["robot_001"].number, patrol.robots["robot_001"].order) == (1, [second, *rest])
    patrol.hear("robot_002", says(2, mission=1, visited=(second,)), 2 * SECOND_NS, silently)
    patrol.review(21, 2 * SECOND_NS, patrol.robots, silently)
    assert (patrol.robots["robot_001"].number, patrol.robots["robot_001"].order) == (21, rest)
    assert patrol.visited_by[[first, second]].tolist() == [1, 2]


def test_work_goes_only_to_robots_that_can_hear_of_it() -> None:
    patrol = patrol_of(street(3, 6))
    patrol.review(1, 0, patrol.robots, silently)
    (handed, *_) = patrol.robots["robot_003"].order  # the western end, where robot_001 stands and says nothing
    for second in range(1, 8):
        patrol.hear("robot_003", says(second, mission=1, given_up=(handed,)), second * SECOND_NS, silently)
        patrol.hear("robot_002", says(second, mission=1), second * SECOND_NS, silently)
    patrol.review(71, 7 * SECOND_NS, patrol.robots, silently)
    assert handed in patrol.robots["robot_002"].order
    assert patrol.robots["robot_001"].order == [] and patrol.robots["robot_001"].number == 1


def test_unknown_waypoints_in_a_status_are_not_believed() -> None:
    patrol = patrol_of(street(1, 3))
    patrol.review(1, 0, patrol.robots, silently)
    patrol.hear("robot_001", says(1, mission=1, visited=(3, 4095), given_up=(77,)), SECOND_NS, silently)
    assert patrol.open() == [0, 1, 2]


def test_how_things_stand_is_told_while_and_after_a_robot_is_silent() -> None:
    run = Run(street(2, 8))
    assert run.node.status.phase == "starting" and run.node.status.manager is None
    run.until(5)
    told = run.node.status
    assert told.manager is not None
    assert (told.sim_time_s, told.phase, told.manager.hash) == (4.0, "mapping", "6d" * 16)
    assert [r.copy_held.version for r in told.robots if r.copy_held] == [7, 7]
    run.drivers["robot_002"].deaf = True
    run.until(12)
    one, two = run.node.status.robots
    assert one.drive_silent_s < 1.0 and one.copy_held.silent_s < 1.0
    assert two.drive_silent_s > 5.0 and two.copy_held.silent_s == two.drive_silent_s and two.state == "driving"
