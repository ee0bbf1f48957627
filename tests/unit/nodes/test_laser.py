"""The laser's step object: newest bodies in, one scan to its own mapper out."""

from __future__ import annotations

import numpy as np
import pytest
from orograph.messages import RANGE_UNIT_M, Bodies, Envelope, Frame, Phase, Scan
from orograph.nodes.laser import LaserNode
from orograph.scene.site import Site
from orograph.sensing import View

ROBOTS = ("robot_001", "robot_002")


@pytest.fixture
def node(flat_world):
    world = flat_world(laser={"rings": 1, "columns": 8, "elevation_min_deg": 0.0, "elevation_max_deg": 0.0}, robots=2)
    return LaserNode(View(Site(world), 1), "robot_002", 1, ROBOTS)


def step(node, frame, *messages):
    sent = []
    inbox = [Envelope("sim", "laser/*", "world", frame - 1, i, message) for i, message in enumerate(messages)]
    node.step(Frame(frame, frame * 10**8, 10**8), inbox, lambda *s: sent.append(s), lambda *n: None)
    return sent


def test_scans_the_newest_bodies_for_its_own_mapper(node, poses_at):
    old = Bodies(300, poses_at((100, 100, 0, 0), (110, 100, 0, 0)))
    new = Bodies(400, poses_at((80, 100, 0, 0), (100, 100, 0, np.pi)))
    for inbox in ((old, new), (new, old)):
        [(plane, to, scan)] = step(node, 5, *inbox)
        assert (plane, to, type(scan), scan.stamp_ns) == ("sim", "robot-mapping/robot_002", Scan, 400)
        assert not scan.ranges.any(), "a level ray passes over a robot of 0.42 m"


def test_says_nothing_without_bodies_or_while_absent(node, poses_at):
    assert step(node, 1) == []
    assert step(node, 2, Phase("mapping")) == []
    assert step(node, 3, Bodies(300, poses_at((100, 100, 0, 0), None))) == []
    assert node.telemetry()["scans"] == 0
    assert node.artifacts()["last_ranges"].shape == (1, 8)


def test_keeps_the_last_scan_and_its_true_pose(flat_world, poses_at):
    wall = {"footprint": [[120, 50], [125, 50], [125, 150], [120, 150]], "height_m": 10}
    node = LaserNode(View(Site(flat_world(buildings=[wall], robots=2)), 1), "robot_002", 1, ROBOTS)
    [(_, _, scan)] = step(node, 5, Bodies(400, poses_at(None, (100, 101, 0, 0))))
    kept = node.artifacts()
    np.testing.assert_array_equal(kept["last_ranges"], scan.ranges)
    np.testing.assert_array_equal(kept["last_position_m"], [100, 101, 0])
    np.testing.assert_array_equal(kept["last_quaternion_wxyz"], [1, 0, 0, 0])
    assert kept["last_stamp_ns"] == 400
    assert scan.ranges[4, 0] * RANGE_UNIT_M == pytest.approx(20 / np.cos(np.radians(25 / 7)), abs=0.0011)
    assert node.telemetry() == {"scans": 1.0, "hits_fraction": np.count_nonzero(scan.ranges) / scan.ranges.size}


def test_sees_what_is_built_from_its_time_on(flat_world, poses_at):
    wall = {"footprint": [[120, 50], [125, 50], [125, 150], [120, 150]], "height_m": 10}
    scenario = flat_world(changes=[{"at_s": 2.0, "until_s": 3.0, "build": wall}], robots=2)
    node = LaserNode(View(Site(scenario), 1), "robot_002", 1, ROBOTS)
    ahead = []
    for frame in (19, 20, 29, 30):
        [(_, _, scan)] = step(node, frame, Bodies(frame * 10**8, poses_at(None, (100, 100, 0, 0))))
        ahead.append(int(scan.ranges[-1, 0]))  # its highest ring
    assert [hit > 0 for hit in ahead] == [False, True, True, False]
