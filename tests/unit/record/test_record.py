"""A record opens with mcap's own reader, survives its recorder, and run again makes the same map."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from mcap.reader import make_reader
from orograph import keys
from orograph.cli.main import main
from orograph.comms.observer import Heard
from orograph.control import Figures
from orograph.messages import UPDATE, Batch, Bodies, Hello, ManagerStatus, Message, Packed, Pose, Scan
from orograph.protocol.manager import ManagerSync
from orograph.protocol.store import MemoryStore
from orograph.record.reading import read_record
from orograph.record.recorder import Recorder
from orograph.record.rerun import rerun
from orograph.rules import Rules
from orograph.scenario import Scenario
from orograph.scene.site import Site
from orograph.storage.run_folder import records

ONE = keys.node(keys.MAPPING, "robot_001")
FRAMES, RESTART = 40, 25


def batch(epoch: int, frame: int) -> Batch:
    records = np.zeros(3, UPDATE)
    records["cell"] = np.arange(3) + frame % 7
    records["seq"], records["tick"], records["height"], records["confidence"] = frame, 100 * frame, 10 * frame, 90
    return Batch(epoch, records)


class Mission:
    """One robot and a manager that is killed once, as they tell each other things."""

    def __init__(self, site: Site, hear: Callable[[Heard], None]) -> None:
        self._site, self._hear, self._store = site, hear, MemoryStore()
        self.manager = self._begun(draw=7_000)
        self._epoch = 0

    def _begun(self, draw: int) -> ManagerSync:
        scenario = self._site.scenario
        return ManagerSync(
            scenario.grid.grid.shape, self._site.prior, Rules.of(scenario.rules), self._store, scenario.robot_ids,
            draw=draw,
        )  # fmt: skip

    def play(self, scan: tuple[Scan, Pose], bodies: Callable[[int], Bodies]) -> None:
        for frame in range(FRAMES):
            if frame == RESTART:
                self.manager = self._begun(draw=33)
            up: Message = Hello(bytes(16)) if frame in (0, RESTART) else batch(self.manager.epoch("robot_001"), frame)
            self._hear(Heard(ONE, keys.MANAGER, frame, up))
            self._hear(Heard(keys.WORLD, keys.group(keys.LASER), frame, bodies(frame)))
            self.manager.step((frame + 1) * self._site.scenario.frame_ns, [("robot_001", up)], self._send(frame + 1))
        self._hear(Heard(keys.LASER + "/robot_001", ONE, FRAMES, scan[0]))
        self._hear(Heard(keys.NAVIGATOR + "/robot_001", ONE, FRAMES, scan[1]))
        self._hear(Heard(keys.MANAGER, "people", -1, Figures({"version": 3.0})))
        status = ManagerStatus(0, 1, self.manager.hash(), 0, np.zeros(0, "<u2"))
        self._hear(Heard(keys.MANAGER, keys.ORCHESTRATOR, FRAMES, status))

    def _send(self, frame: int) -> Callable[[str | None, Message], None]:
        def send(robot: str | None, message: Message) -> None:
            to = keys.group(keys.MAPPING) if robot is None else keys.node(keys.MAPPING, robot)
            self._hear(Heard(keys.MANAGER, to, frame, message))

        return send


@pytest.fixture
def site(scenario_of: Callable[..., Scenario]) -> Site:
    return Site(scenario_of(laser={"rings": 4, "columns": 8}))


@pytest.fixture
def recorder(site: Site, tmp_path: Path, poses_at: Callable[..., Packed]) -> Recorder:
    recorder = Recorder(site, tmp_path, {"commit": "abc"})
    stamp_ns = FRAMES * site.scenario.frame_ns
    scan = Scan(stamp_ns, np.full((4, 8), 2_000, "<u2")), Pose(stamp_ns, 50.0, 50.0, 0.0, 0.0, 0.0, 0.0, 0.1)
    mission = Mission(site, recorder.hear)
    mission.play(scan, lambda frame: Bodies(frame * site.scenario.frame_ns, poses_at((50.0 + frame, 50.0, 0.0, 0.0))))
    recorder.write(0.0)
    return recorder


def test_other_programs_find_map_frames_scans_and_who_made_it(recorder: Recorder, tmp_path: Path) -> None:
    with recorder:
        pass
    with (tmp_path / "record-001.mcap").open("rb") as stream:
        reader = make_reader(stream)
        kinds = {channel.topic: schema.name for schema, channel, _ in reader.iter_messages() if schema}
        (metadata,) = reader.iter_metadata()
    clouds = dict.fromkeys(("/map/surface", "/scan/robot_001"), "PointCloud")
    wanted = {"/map/grid": "Grid", "/tf": "FrameTransforms", **clouds}
    assert wanted.items() <= {topic: kind.removeprefix("foxglove.") for topic, kind in kinds.items()}.items()
    assert "/figures/map-manager" in kinds and metadata.metadata["commit"] == "abc"


def test_run_again_it_makes_the_recorded_map(recorder: Recorder, tmp_path: Path, site: Site) -> None:
    with recorder:
        pass
    record = read_record(tmp_path / "record-001.mcap")
    found = rerun([record])
    assert record.whole and record.scenario == site.scenario and found.messages == FRAMES
    assert found.agrees and found.reached_hash != rerun([record.__class__(record.scenario, {}, (), True)]).reached_hash
    assert main(["rerun", str(tmp_path / "record-001.mcap")]) == 0


def test_what_was_written_outlives_a_recorder_that_is_killed(
    recorder: Recorder, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    left = tmp_path / "left.mcap"
    left.write_bytes((tmp_path / "record-001.mcap").read_bytes())  # as it lies on the disk now, never closed
    with recorder:
        pass
    found, whole = read_record(left), read_record(tmp_path / "record-001.mcap")
    assert not found.whole and len(found.told) == len(whole.told) > FRAMES
    assert main(["rerun", str(left)]) == 0
    assert "was cut short" in capsys.readouterr().out
    left.write_bytes(left.read_bytes()[: left.stat().st_size // 2])
    assert len(read_record(left).told) < len(whole.told)


def test_a_long_record_is_cut_into_parts_of_which_the_newest_stay(site: Site, tmp_path: Path) -> None:
    with Recorder(site, tmp_path, {}, part_bytes=0) as recorder:
        for number in range(12):
            recorder.hear(Heard(ONE, keys.MANAGER, number, batch(1, number)))
            recorder.safe()
    parts = [read_record(path) for path in records(tmp_path)]
    assert len(parts) == 8 and all(part.whole and part.scenario == site.scenario for part in parts)
    assert [t.stamp_ns // site.scenario.frame_ns for part in parts for t in part.told] == list(range(5, 12))


@pytest.mark.parametrize("content", [b"", b"no record at all", b"\x89MCAP0\r\n"])
def test_what_is_no_record(tmp_path: Path, capsys: pytest.CaptureFixture[str], content: bytes) -> None:
    (tmp_path / "x.mcap").write_bytes(content)
    assert main(["rerun", str(tmp_path / "x.mcap")]) == 2
    assert main(["rerun", str(tmp_path / "none.mcap")]) == 2
    said = capsys.readouterr().err.splitlines()
    assert len(said) == 2 and all(line.startswith("orograph: ") for line in said)
