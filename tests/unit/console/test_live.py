"""What is heard becomes a film; stale, doubled and strange messages change nothing."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import closing
from pathlib import Path

import numpy as np
import pytest
from orograph import keys
from orograph.comms.observer import Heard
from orograph.console.live import LiveFilm
from orograph.messages import CELL, UPDATE, Batch, Bodies, Delta, Hello, MappingStatus, Message, Packed
from orograph.protocol.manager import ManagerSync
from orograph.rules import Rules
from orograph.runtime.briefing import Briefing
from orograph.scenario import Scenario
from orograph.scene.site import Site
from orograph.storage.copied_state import copied_state
from orograph.storage.run_folder import STORE
from orograph.storage.sqlite_store import SqliteStore

ONE = "robot_001"


@pytest.fixture
def live(scenario_of: Callable[..., Scenario], tmp_path: Path) -> LiveFilm:
    shadow = {"default": 1, "areas": [{"rectangle_m": [0, 0, 20, 20], "value": 0}]}
    return LiveFilm(Briefing(scenario_of(communications=shadow), tmp_path))


def hear(live: LiveFilm, frame: int, message: Message, sender: str, to: str) -> None:
    live.hear(Heard(sender, to, frame, message))


def cells(*versioned: tuple[int, int, int]) -> Packed:
    out = np.zeros(len(versioned), CELL)
    for row, (cell, version, height) in zip(out, versioned, strict=True):
        row["cell"], row["version"], row["height"] = cell, version, height
    return out


def tell_map(live: LiveFilm, frame: int, epoch: int, *versioned: tuple[int, int, int]) -> None:
    delta = Delta(epoch, 0, 9, 0, 1, False, cells(*versioned))
    hear(live, frame, delta, keys.MANAGER, keys.group(keys.MAPPING))


def heights(live: LiveFilm) -> dict[int, int]:
    return {int(row["cell"]): int(row["height"]) for row in live.film().changes}


def test_cells_count_by_version_and_a_manager_that_began_anew_is_believed(live: LiveFilm) -> None:
    tell_map(live, 5, 1, (3, 4, 40), (7, 4, 70))
    tell_map(live, 6, 1, (3, 2, 20), (7, 4, 71), (399_999, 9, 1))
    assert heights(live) == {3: 40, 7: 70}
    tell_map(live, 7, 2, (3, 1, 10))
    tell_map(live, 8, 1, (3, 9, 90))
    assert heights(live) == {3: 10, 7: 70}
    assert live.film().changes["stamp_ns"].tolist() == [500_000_000, 500_000_000, 700_000_000]


def test_bodies_make_courses_with_radio_by_place(live: LiveFilm, poses_at: Callable[..., Packed]) -> None:
    for stamp_ns, x in ((100_000_000, 50.0), (200_000_000, 10.0), (150_000_000, 99.0)):
        hear(live, 1, Bodies(stamp_ns, poses_at((x, 10.0, 0.0, 1.5))), keys.WORLD, keys.group(keys.LASER))
    hear(live, 3, Bodies(300_000_000, poses_at(None)), keys.WORLD, keys.group(keys.LASER))
    rows = live.film().robots[ONE]
    np.testing.assert_allclose(rows[:, 1:6], [[50, 10, 0, 1.5, 1], [10, 10, 0, 1.5, 0]], atol=1e-6)
    assert live.film().end_ns == 200_000_000 and not live.begun_anew
    for stamp_ns in (60_000_000_000, 100_000_000):
        hear(live, 1, Bodies(stamp_ns, poses_at((50.0, 10.0, 0.0, 0.0))), keys.WORLD, keys.group(keys.LASER))
    assert live.begun_anew


def test_registers_are_the_newest_of_each_robot(live: LiveFilm) -> None:
    for epoch, seq, height in ((1, 5, 50), (1, 4, 40), (2, 1, 10), (1, 9, 90)):
        records = np.zeros(1, UPDATE)
        records["cell"], records["seq"], records["height"], records["confidence"] = 8, seq, height, 99
        hear(live, 1, Batch(epoch, records), keys.node(keys.MAPPING, ONE), keys.MANAGER)
    registers = live.film().registers()
    assert registers[["robot", "epoch", "cell", "seq", "height"]].tolist() == [(1, 2, 8, 1, 10)]


def test_one_that_comes_late_begins_with_what_was_committed(
    live: LiveFilm, scenario_of: Callable[..., Scenario], tmp_path: Path
) -> None:
    site = Site(scenario_of())
    with closing(SqliteStore(tmp_path / STORE, (20, 20))) as store:
        manager = ManagerSync((20, 20), site.prior, Rules.of(site.scenario.rules), store, (ONE,))
        records = np.zeros(1, UPDATE)
        records["cell"], records["seq"], records["height"], records["confidence"] = 8, 1, 4_000, 200
        for now_ns, message in ((0, Hello(bytes(16))), (1, Batch(1, records))):
            manager.step(now_ns, [(ONE, message)], lambda robot, message: None)
        live.catch_up(copied_state(tmp_path, (20, 20)))  # while its manager still holds the store
    assert heights(live) == {8: int(manager.glrm["height"][8])} and manager.glrm["confidence"][8] > 100
    assert live.film().registers()["cell"].tolist() == [8]
    tell_map(live, 9, manager.manager_epoch, (8, manager.version, 1), (9, manager.version + 1, 2))
    assert heights(live) == {8: int(manager.glrm["height"][8]), 9: 2}


@pytest.mark.parametrize("content", [None, b"", b"no store" * 100])
def test_no_store_or_none_that_can_be_read_is_nothing_committed(tmp_path: Path, content: bytes | None) -> None:
    if content is not None:
        (tmp_path / STORE).write_bytes(content)
    held = copied_state(tmp_path, (20, 20))
    assert held.version == 0 and not held.registers


def test_backlog_and_events(live: LiveFilm, tmp_path: Path) -> None:
    status = MappingStatus(1_000_000_000, False, 17, 0, bytes(16))
    hear(live, 10, status, keys.node(keys.MAPPING, ONE), keys.ORCHESTRATOR)
    hear(live, 10, status, keys.node(keys.MAPPING, "robot_099"), keys.ORCHESTRATOR)
    (tmp_path / "parts/events").mkdir(parents=True)
    (tmp_path / "parts/events/world.jsonl").write_text(
        '{"event": "mission", "robot": "robot_001", "waypoints": [0]}\n{"e'
    )
    film = live.film()
    assert film.waiting(ONE, 999_999_999) == 0 and film.waiting(ONE, 1_000_000_000) == 17
    assert film.legs(0) == {ONE: [0]}
