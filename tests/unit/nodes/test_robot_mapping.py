"""The robot-mapping node against a real map-manager node over a perfect or silent radio."""

import numpy as np
import pytest
from orograph import keys
from orograph.geometry import ray_directions
from orograph.layers import UNKNOWN_OCCUPATION
from orograph.messages import Batch, Envelope, MappingStatus, OccupancyGrid, Phase, Pose, Scan  # fmt: skip
from orograph.nodes.map_manager import MapManagerNode
from orograph.nodes.robot_mapping import RobotMappingNode, ScanPoseSync
from orograph.protocol.store import MemoryStore
from orograph.runtime.network import Network
from orograph.runtime.rounds import Rounds
from orograph.scenario import Scenario
from orograph.scene.site import Site

ROBOT = "robot_001"
ME, LASER, NAVIGATOR = (keys.node(service, ROBOT) for service in (keys.MAPPING, keys.LASER, keys.NAVIGATOR))
SCENARIO = Scenario.model_validate(
    {
        "name": "bench-street", "title": "A street", "starts": [{"x_m": 30, "y_m": 30}], "base_station_m": (5, 5),
        "patrol": [(40, 40)], "robots": 1, "grid": {"rows": 16, "cols": 16}, "hrm": {"cells": 80},
        "terrain": {"slope_x": 0.03},
        "buildings": [{"footprint": [(50, 50), (65, 50), (65, 65), (50, 65)], "height_m": 8}],
        "laser": {"rings": 36, "columns": 180, "range_max_m": 30},
    }
)  # fmt: skip
SITE = Site(SCENARIO)
DIRECTIONS = ray_directions(SCENARIO.laser)


def scan_from(x_m: float, y_m: float, stamp_ns: int) -> Scan:
    """What the level robot at (x, y) sees of flat ground 0.45 m below its laser, and of a wall at x = 33.7 m."""
    with np.errstate(divide="ignore"):
        ground = np.where(DIRECTIONS[..., 2] < 0, -0.45 / DIRECTIONS[..., 2], np.inf)
        wall = np.where(DIRECTIONS[..., 0] > 0, (33.7 - x_m) / DIRECTIONS[..., 0], np.inf)
    distance = np.minimum(ground, wall)
    return Scan(stamp_ns, np.where(distance < 30, np.round(distance / 0.002), 0).astype("<u2"))


class Says:
    """A node that says what it is told to."""

    def __init__(self, name: str, words) -> None:
        self.name, self._words = name, words

    def step(self, frame, inbox, send, note) -> None:
        for message in self._words(frame):
            send(*message)


class Heard(Network):
    """Keeps all that was sent."""

    def __init__(self, *args) -> None:
        super().__init__(*args)
        self.sent: list[Envelope] = []

    def carry(self, frame, sent) -> None:
        self.sent += sent
        super().carry(frame, sent)


class Round:
    """Node and manager in rounds; `radio` False loses all that the robot says and is told on the radio plane."""

    def __init__(self, nonce: bytes = b"n" * 16) -> None:
        self.radio, self.phase, self._at, self._scans = True, "mapping", (30.0, 30.0), True
        self.manager, self.notes = MapManagerNode(SITE, (ROBOT,), MemoryStore()), []
        self.node = RobotMappingNode(SITE, ROBOT, 1, nonce)
        others = [
            Says(LASER, self._laser),
            Says(NAVIGATOR, self._navigator),
            Says(keys.ORCHESTRATOR, self._orchestrator),
        ]
        nodes = [self.manager, self.node, *others]
        self._network = Heard(SCENARIO, [node.name for node in nodes], lambda: {ROBOT: self.radio})
        self._rounds = Rounds(SCENARIO.frame_ns, nodes, self._network, lambda *note: self.notes.append(note[2]))

    @property
    def sent(self) -> list[Envelope]:
        return self._network.sent

    def restart(self, nonce: bytes) -> None:
        nodes = self._rounds.nodes
        nodes[nodes.index(self.node)] = self.node = RobotMappingNode(SITE, ROBOT, 1, nonce)

    def lose_disk(self) -> None:
        nodes, lost = self._rounds.nodes, self.manager
        nodes[nodes.index(lost)] = self.manager = MapManagerNode(SITE, (ROBOT,), MemoryStore(), draw=1_000)

    def _laser(self, frame):
        return [(keys.SIM, ME, scan_from(*self._at, frame.stamp_ns))] if self._scans and frame.index % 4 == 0 else []

    def _navigator(self, frame):
        return [(keys.SIM, ME, Pose(frame.stamp_ns, *self._at, 0.0, 0.0, 0.0, 0.0, 0.1))]

    def _orchestrator(self, frame):
        return [(keys.RADIO, keys.group(keys.MAPPING), Phase(self.phase))] if frame.index % 10 == 0 else []

    def run(self, frames: int, at=(30.0, 30.0), scans: bool = True) -> list[Envelope]:
        self._at, self._scans, begin = at, scans, len(self.sent)
        for _ in range(frames):
            self._rounds.step()
        return self.sent[begin:]

    def flush(self) -> None:
        self.phase = "flush"
        for _ in range(60):
            self.run(1)
            if "flushed" in self.notes:
                break
        self.run(60)


def of(kind: type, envelopes: list[Envelope]) -> list:
    return [e.message for e in envelopes if isinstance(e.message, kind)]


def test_after_the_flush_manager_and_robot_hold_the_same():
    round_ = Round()
    for k in range(12):
        round_.run(4, at=(30.0 - k, 30.0 + 0.7 * k))
    assert not any(s.flushed for s in of(MappingStatus, round_.sent))
    round_.flush()
    robot, manager = round_.node.artifacts(), round_.manager.artifacts()
    for name in ("cell", "tick", "height", "gradient_x", "gradient_y", "occupation", "confidence"):
        np.testing.assert_array_equal(robot["registers"][name], manager["registers"][name])
        np.testing.assert_array_equal(robot["registers"][name], robot["acknowledged"][name])
    for name in ("cell", "height", "gradient_x", "gradient_y", "occupation", "confidence"):
        np.testing.assert_array_equal(robot["copy"][name], manager["glrm"][name])
    status = of(MappingStatus, round_.sent)[-1]
    assert status.flushed and status.waiting_cells == 0
    assert status.copy_hash == manager["glrm_hash"].tobytes()
    once = [note for note in round_.notes if note in ("welcome", "flushed")]
    assert round_.notes[0] == "hello" and once == ["welcome", "flushed"]


def test_during_the_flush_evidence_stands_still():
    round_ = Round()
    round_.run(20)
    round_.flush()
    before = round_.node.artifacts()["registers"]
    round_.run(20, at=(25.0, 30.0))
    np.testing.assert_array_equal(round_.node.artifacts()["registers"], before)


def test_without_radio_it_maps_on_and_catches_up():
    round_ = Round()
    round_.radio = False
    round_.run(60)
    waiting = round_.node.telemetry()["waiting_cells"]
    assert waiting > 10 and round_.node.telemetry()["link_up"] == 0
    round_.radio = True
    round_.flush()
    assert round_.node.telemetry()["waiting_cells"] == 0 and round_.node.telemetry()["link_up"] == 1
    assert len(round_.manager.artifacts()["registers"]) == len(round_.node.artifacts()["registers"]) >= waiting


def test_the_backlog_is_what_each_status_said():
    round_ = Round()
    round_.radio = False
    round_.run(60)
    round_.radio = True
    round_.flush()
    told = [(s.stamp_ns, s.waiting_cells) for s in of(MappingStatus, round_.sent)]
    backlog = round_.node.artifacts()["backlog"]
    assert backlog.dtype == np.int64 and list(map(tuple, backlog.tolist())) == told
    assert max(backlog[:, 1]) > 10 and backlog[-1, 1] == 0
    assert Round().node.artifacts()["backlog"].shape == (0, 2)


def test_a_standing_robot_does_not_send_the_same_again_and_again():
    round_ = Round()
    round_.run(100)
    batches = of(Batch, round_.run(200))
    cells = round_.node.telemetry()["records_acked"]
    assert sum(len(b.records) for b in batches) < 0.1 * cells


def test_what_already_waits_in_the_same_form_is_not_offered_anew():
    """100 scans without an acknowledgement: only a cell that moved since its last offer gets a new seq."""
    round_ = Round()
    round_.radio = False
    round_.run(400)
    round_.radio = True
    first = next(iter(of(Batch, round_.run(60, scans=False))))
    assert first.records["seq"].max() < 10 * round_.node.telemetry()["records_acked"]


def test_a_restarted_robot_takes_its_row_over():
    round_ = Round()
    round_.run(60)
    before = {int(r["cell"]): int(r["confidence"]) for r in round_.node.artifacts()["acknowledged"]}
    round_.restart(b"m" * 16)
    round_.run(60, at=(32.0, 30.0))
    after = {int(r["cell"]): int(r["confidence"]) for r in round_.node.artifacts()["registers"]}
    assert set(before) <= set(after) and len(before) > 10
    assert round_.notes.count("welcome") == 2
    round_.flush()
    robot, manager = round_.node.artifacts(), round_.manager.artifacts()
    np.testing.assert_array_equal(robot["registers"]["confidence"], manager["registers"]["confidence"])
    held = dict(zip(robot["registers"]["cell"].tolist(), robot["registers"]["confidence"].tolist(), strict=True))
    fallen = [(cell, old, held[cell]) for cell, old in before.items() if held[cell] < old]
    assert not fallen, f"invariant 10: (cell, before, after) {fallen}"


@pytest.mark.parametrize("phase", ["mapping", "flush"])
def test_a_manager_without_its_disk_gets_everything_again(phase):
    round_ = Round()
    round_.run(60)
    if phase == "flush":
        round_.flush()
        assert of(MappingStatus, round_.sent)[-1].flushed
    round_.lose_disk()
    round_.run(60, scans=phase == "mapping")
    assert round_.notes.count("store-lost") == 1 and round_.notes.count("hello") >= 2
    round_.notes.clear()
    round_.flush()
    robot, manager = round_.node.artifacts(), round_.manager.artifacts()
    assert len(robot["registers"]) > 10
    for name in ("cell", "tick", "height", "gradient_x", "gradient_y", "occupation", "confidence"):
        np.testing.assert_array_equal(robot["registers"][name], manager["registers"][name])
    for name in ("cell", "height", "gradient_x", "gradient_y", "occupation", "confidence"):
        np.testing.assert_array_equal(robot["copy"][name], manager["glrm"][name])
    assert of(MappingStatus, round_.sent)[-1].flushed


def test_planning_hears_the_global_map_at_once_and_the_local_one_after_each_scan():
    round_ = Round()
    maps = of(OccupancyGrid, round_.run(1, scans=False))
    assert [m.is_global for m in maps] == [True]
    assert maps[0].occupation.shape == (16, 16) and maps[0].cell_m == 5.0
    assert maps[0].occupation[11, 11] == 254, "the building of the prior"
    local = [m for m in of(OccupancyGrid, round_.run(41)) if not m.is_global]
    assert len(local) == 10
    newest = local[-1]
    assert (newest.x0_m, newest.y0_m, newest.cell_m, newest.occupation.shape) == (10.0, 10.0, 0.5, (80, 80))
    assert newest.occupation[40, 47] == 254, "the wall at x = 33.7"
    assert newest.occupation[40, 43] < 64, "the ground before it"
    assert newest.occupation[79, 79] == maps[0].occupation[9, 9], "unseen: as told"
    assert not (newest.occupation == UNKNOWN_OCCUPATION).all()


def test_the_global_map_comes_again_when_the_copy_changed_but_not_oftener_than_every_two_seconds():
    round_ = Round()
    sent = [e for e in round_.run(100) if isinstance(e.message, OccupancyGrid) and e.message.is_global]
    gaps = np.diff([e.frame for e in sent])
    assert len(sent) >= 3 and (gaps >= 20).all()


def test_the_artifacts_show_the_hrm_before_and_after():
    round_ = Round()
    round_.run(40)
    arrays = round_.node.artifacts()
    assert arrays["hrm_height"].shape == arrays["initial_hrm_height"].shape == (80, 80)
    np.testing.assert_array_equal(arrays["hrm_origin_m"], [10.0, 10.0])
    assert arrays["initial_hrm_height"][70, 0] == pytest.approx(12.5 * 0.03, abs=1e-3), "the prior's slope"
    assert arrays["initial_hrm_height"][79, 79] == pytest.approx(47.5 * 0.03, abs=1e-3)
    assert arrays["hrm_confidence"].max() > 64 >= 63 >= arrays["hrm_confidence"][79, 79] > 0
    assert arrays["scans"] == round_.node.telemetry()["scans"] == 10


def test_a_node_that_never_scanned_has_artifacts_too():
    arrays = Round().node.artifacts()
    assert arrays["registers"].size == 0 and "hrm_height" not in arrays


def test_scans_wait_for_their_pose_and_are_skipped_when_it_does_not_come():
    arrivals = ScanPoseSync(wait_ns=500)
    pose = Pose(200, 1.0, 2.0, 0.0, 0.0, 0.0, 0.0, 0.1)
    scans = [Scan(stamp, np.zeros((1, 8), "<u2")) for stamp in (100, 200, 300)]
    for scan in scans:
        arrivals.take(scan)
    assert arrivals.pairs(300) == []
    arrivals.take(pose)
    assert arrivals.pairs(400) == [(scans[1], pose)]
    assert arrivals.pairs(600) == [] and arrivals.skipped == 0
    assert arrivals.pairs(601) == [] and arrivals.skipped == 1
    assert arrivals.pairs(900) == [] and arrivals.skipped == 2
