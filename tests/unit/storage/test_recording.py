"""Events reach the disk one by one; a full disk costs events and not the process."""

import json
import logging
from pathlib import Path

import pytest
from orograph.storage.recording import Recording


def test_an_event_is_a_line_at_once(tmp_path: Path) -> None:
    with Recording(tmp_path, "laser-1") as recording:
        recording.note(7, "laser/robot_001", "hello", {"epoch": 3})
        text = (tmp_path / "parts/events/laser-1.jsonl").read_text()
    assert json.loads(text) == {
        "stamp_ns": 7, "service": "laser", "robot": "robot_001", "event": "hello", "epoch": 3,
    }  # fmt: skip


def test_a_full_disk_costs_events_only(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    with Recording(tmp_path, "map-manager-1") as recording, Path("/dev/full").open("ab", buffering=0) as full:
        recording.note(1, "map-manager", "hello", {})
        room, recording._events = recording._events, full
        with caplog.at_level(logging.WARNING):
            recording.note(2, "map-manager", "store-full", {})
        recording._events = room
        recording.note(3, "map-manager", "store-freed", {})
    lines = (tmp_path / "parts/events/map-manager-1.jsonl").read_text().splitlines()
    assert [json.loads(line)["event"] for line in lines] == ["hello", "store-freed"]
    assert recording.dropped == 1 and "store-full" in caplog.text
