"""What `orograph run` says of a run that did not do its work, or hit something."""

from __future__ import annotations

from made_up.run import made_up_summary
from orograph.cli.run import lacking
from orograph.storage.results import Contact

CRASH = Contact(robot="robot_002", body="vehicle_000", since_s=152.3, newtons=14321.0, seconds=0.4, x_m=1.0, y_m=2.0)


def test_a_whole_run_lacks_nothing() -> None:
    assert list(lacking(made_up_summary(2))) == []


def test_what_was_not_visited_is_named_with_the_coverage() -> None:
    short = made_up_summary(2).model_copy(update={"complete": False, "waypoints_missed": (1, 3)})
    assert list(lacking(short)) == [
        "incomplete: 2 of 4 waypoints not visited (1, 3); coverage 97.0% of what the patrol can see"
    ]


def test_all_visited_and_yet_incomplete_is_a_robot_that_never_flushed() -> None:
    (line,) = lacking(made_up_summary(2).model_copy(update={"complete": False}))
    assert line.startswith("incomplete: a robot never brought its last cells home; coverage")


def test_a_collision_is_told_of_a_complete_run_too() -> None:
    (line,) = lacking(made_up_summary(2).model_copy(update={"contacts": (CRASH,)}))
    assert line == "collision: robot_002 and vehicle_000 after 152.3 s, 14,321 N for 0.4 s"
