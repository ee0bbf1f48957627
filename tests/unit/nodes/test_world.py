"""The world's node: what it sends when, how drives expire, what it records and notes."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import pytest
from orograph.messages import Bodies, Drive, Envelope, Frame, Message, RunEnd, Sensors
from orograph.nodes.world import WorldNode
from orograph.scenario import Area, Building, Change, GivenLayer, Parked, Scenario, Start

Make = Callable[..., Scenario]
FRAME_NS = 100_000_000
TWO = ("robot_001", "robot_002")
STARTS = (Start(x_m=50, y_m=50), Start(x_m=50, y_m=60, heading_deg=90))


class Bench:
    """Steps a node frame by frame and keeps what it sends and notes."""

    def __init__(self, node: WorldNode) -> None:
        self.node, self.frame = node, 0
        self.sent: list[tuple[int, str, str, Message]] = []
        self.notes: list[tuple[str, Any]] = []

    def step(self, messages: Sequence[tuple[str, Message]] = ()) -> None:
        inbox = [Envelope("sim", "world", sender, self.frame - 1, i, m) for i, (sender, m) in enumerate(messages)]
        self.node.step(
            Frame(self.frame, self.frame * FRAME_NS, FRAME_NS),
            inbox,
            lambda plane, to, message: self.sent.append((self.frame, plane, to, message)),
            lambda kind, fields: self.notes.append((kind, fields)),
        )
        self.frame += 1

    def of(self, kind: type[Message]) -> list[tuple[int, str, Any]]:
        return [(frame, to, message) for frame, _, to, message in self.sent if isinstance(message, kind)]


def test_sends_bodies_every_fourth_frame_and_sensors_each(scenario_of: Make) -> None:
    bench = Bench(WorldNode(scenario_of(starts=STARTS), TWO, 1))
    for _ in range(9):
        bench.step()
    assert [(frame, to) for frame, to, _ in bench.of(Bodies)] == [(k, "laser/*") for k in (0, 4, 8)]
    assert [to for _, to, _ in bench.of(Sensors)] == ["navigator/robot_001", "navigator/robot_002"] * 9
    assert all(message.stamp_ns == frame * FRAME_NS for frame, _, message in bench.of(Bodies) + bench.of(Sensors))
    assert {plane for _, plane, _, _ in bench.sent} == {"sim"}


def test_first_frame_is_the_start_itself(scenario_of: Make) -> None:
    bench = Bench(WorldNode(scenario_of(starts=STARTS), TWO, 1))
    bench.step()
    poses = bench.of(Bodies)[0][2].poses
    assert poses["position_m"][:, :2] == pytest.approx(np.array([[50, 50], [50, 60]]))
    assert poses["quaternion_wxyz"][1] == pytest.approx([math.sqrt(0.5), 0, 0, math.sqrt(0.5)])
    assert bench.node.world.stamp_ns == 0


def test_a_drive_holds_for_half_a_second(scenario_of: Make) -> None:
    bench = Bench(WorldNode(scenario_of(starts=STARTS), TWO, 1))
    bench.step()
    bench.step([("navigator/robot_002", Drive(0, 2.0, 0.0))])
    for _ in range(4):
        bench.step()
    assert bench.node.world.speed_mps("robot_002") > 0.9
    for _ in range(10):
        bench.step()
    truth = bench.node.artifacts()["robot_002_truth"]
    assert abs(truth[-1, 5]) < 0.02 and truth[-1, 2] > 60.4
    assert bench.node.world.position_m("robot_001") == pytest.approx([50, 50, 0], abs=0.01)


def test_only_navigators_drive_and_only_their_own_robot(scenario_of: Make) -> None:
    bench = Bench(WorldNode(scenario_of(starts=STARTS), TWO, 1))
    for _ in range(6):
        bench.step([("navigator/robot_009", Drive(0, 2.0, 0.0)), ("orchestrator", Drive(0, 2.0, 0.0))])
    for robot in TWO:
        assert bench.node.world.speed_mps(robot) == pytest.approx(0.0, abs=0.02)


def test_run_end_is_kept(scenario_of: Make) -> None:
    bench = Bench(WorldNode(scenario_of(), ("robot_001",), 1))
    bench.step()
    assert bench.node.ended is None
    bench.step([("orchestrator", RunEnd(complete=True, copies_equal=False))])
    assert bench.node.ended is not None and bench.node.ended.complete


def test_radio_and_gps_follow_the_true_position(scenario_of: Make) -> None:
    shadow = GivenLayer(default=1, areas=(Area(rectangle_m=(55, 0, 100, 100), value=0),))
    poor = GivenLayer(default=2, areas=(Area(rectangle_m=(55, 0, 100, 100), value=1),))
    bench = Bench(WorldNode(scenario_of(communications=shadow, gps_quality=poor), ("robot_001",), 1))
    assert bench.node.radio_up() == {"robot_001": True}
    for _ in range(40):
        bench.step([("navigator/robot_001", Drive(0, 3.0, 0.0))])
    assert bench.node.radio_up() == {"robot_001": False}
    assert [kind for kind, _ in bench.notes] == ["radio-lost"]
    truth, radio = (bench.node.artifacts()[f"robot_001_{name}"] for name in ("truth", "radio"))
    assert (radio == (truth[:, 1] < 55)).all() and radio.dtype == np.bool_
    qualities = [message.gps_quality for _, _, message in bench.of(Sensors)]
    assert qualities == [2 if x < 55 else 1 for x in truth[:, 1]]


def test_sensed_yaw_rate_is_the_mean_over_the_frame(scenario_of: Make) -> None:
    bench = Bench(WorldNode(scenario_of(), ("robot_001",), 1))
    for _ in range(30):
        bench.step([("navigator/robot_001", Drive(0, 0.5, 1.0))])
    sensed = np.array([message.yaw_rate_radps for _, _, message in bench.of(Sensors)])
    yaw = np.unwrap(bench.node.artifacts()["robot_001_truth"][:, 4])
    assert sensed[1:] == pytest.approx(np.diff(yaw) / 0.1, abs=0.01)
    assert abs(sensed[0]) < 0.01


def test_an_absent_robot_is_not_there(scenario_of: Make) -> None:
    bench = Bench(WorldNode(scenario_of(starts=STARTS), TWO, 1))
    bench.node.present.discard("robot_001")
    bench.step()
    assert list(bench.of(Bodies)[0][2].poses["present"]) == [0, 1]
    assert [to for _, to, _ in bench.of(Sensors)] == ["navigator/robot_002"]
    bench.node.present.add("robot_001")
    bench.step()
    assert [to for frame, to, _ in bench.of(Sensors) if frame == 1] == ["navigator/robot_001", "navigator/robot_002"]
    assert bench.node.telemetry()["robots"] == 2


def test_a_tipped_robot_is_noted_once(scenario_of: Make) -> None:
    bench = Bench(WorldNode(scenario_of(), ("robot_001",), 1))
    bench.step()
    on_its_side = np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]])
    bench.node.world._bodies["robot_001"].place(on_its_side, [50, 50, 0.4])
    for _ in range(3):
        bench.step()
    assert [kind for kind, _ in bench.notes] == ["robot-tipped"]


def test_artifacts_have_a_row_per_frame(scenario_of: Make) -> None:
    bench = Bench(WorldNode(scenario_of(), ("robot_001",), 1))
    for _ in range(5):
        bench.step()
    truth = bench.node.artifacts()["robot_001_truth"]
    assert truth.shape == (5, 6) and list(truth[:, 0]) == [k * FRAME_NS for k in range(5)]


def test_what_is_built_and_pulled_down_is_noted(scenario_of: Make) -> None:
    wall = Building(footprint=((60, 40), (62, 40), (62, 60), (60, 60)), height_m=3)
    changes = (Change(at_s=0, until_s=0.2, park=Parked(x_m=80, y_m=50)), Change(at_s=0.1, build=wall))
    bench = Bench(WorldNode(scenario_of(changes=changes), ("robot_001",), 1))
    for _ in range(4):
        bench.step()
    assert [(kind, fields["change"], fields["what"]) for kind, fields in bench.notes] == [
        ("scene-changed", 0, "parked"), ("scene-changed", 1, "built"), ("scene-changed", 0, "left"),
    ]  # fmt: skip


def test_a_collision_is_noted_once_it_is_over_and_counted_at_once(scenario_of: Make) -> None:
    wall = Building(footprint=((52, 40), (53, 40), (53, 60), (52, 60)), height_m=3)
    bench = Bench(WorldNode(scenario_of(buildings=(wall,)), ("robot_001",), 1))
    for k in range(40):
        bench.step([("navigator/robot_001", Drive(0, 2.0 if k < 15 else -1.0, 0.0))])
    [(kind, contact)] = bench.notes
    assert (kind, contact["robot"], contact["body"]) == ("contact", "robot_001", "building")
    assert contact["newtons"] > 300 and 0.1 <= contact["seconds"] < 1.5 and 0.5 < contact["since_s"] < 1.6
    assert contact["x_m"] == pytest.approx(52 - 0.36, abs=0.3)
    assert bench.node.telemetry()["contacts"] >= 1


def test_a_collision_that_lasts_to_the_end_is_noted_then(scenario_of: Make) -> None:
    wall = Building(footprint=((52, 40), (53, 40), (53, 60), (52, 60)), height_m=3)
    bench = Bench(WorldNode(scenario_of(buildings=(wall,)), ("robot_001",), 1))
    for _ in range(20):
        bench.step([("navigator/robot_001", Drive(0, 2.0, 0.0))])
    assert not bench.notes
    bench.step([("orchestrator", RunEnd(complete=True, copies_equal=True))])
    assert [kind for kind, _ in bench.notes] == ["contact"]
