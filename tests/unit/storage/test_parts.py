"""Events as services note them while a run goes on."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from orograph.storage.parts import EventTail, read_events
from orograph.storage.run_folder import events_file


@pytest.fixture
def world(tmp_path: Path) -> Path:
    path = tmp_path / events_file("world")
    path.parent.mkdir(parents=True)
    return path


def note(path: Path, *stamps_ns: int, end: str = "\n") -> None:
    with path.open("a") as stream:
        stream.write("\n".join(json.dumps({"stamp_ns": stamp_ns}) for stamp_ns in stamps_ns) + end)


def stamps(tail: EventTail) -> list[int]:
    return [event["stamp_ns"] for event in tail.news()]


def test_each_event_is_told_once_also_one_that_is_noted_late(world: Path, tmp_path: Path) -> None:
    tail, other = EventTail(tmp_path), tmp_path / events_file("laser-1")
    assert stamps(tail) == []
    note(world, 30, 50)
    assert stamps(tail) == [30, 50]
    note(other, 20, 40)  # noted earlier in simulation, found later
    note(world, 60)
    assert stamps(tail) == [20, 40, 60]
    assert stamps(tail) == []
    assert [event["stamp_ns"] for event in read_events(tmp_path)] == [20, 30, 40, 50, 60]


def test_a_line_that_is_not_complete_yet_comes_later(world: Path, tmp_path: Path) -> None:
    tail = EventTail(tmp_path)
    note(world, 10, end='\n{"stamp_')
    assert stamps(tail) == [10]
    with world.open("a") as stream:
        stream.write('ns": 20}\n')
    assert stamps(tail) == [20]


def test_what_is_no_event_is_passed_over(world: Path, tmp_path: Path) -> None:
    world.write_bytes(b'\xff\xfe\n[1]\n{"stamp_ns": 5}\n')
    assert stamps(EventTail(tmp_path)) == [5]
    assert len(read_events(tmp_path)) == 1
