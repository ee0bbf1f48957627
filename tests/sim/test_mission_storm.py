"""A whole mission in one process in bad weather, with a robot's mapping and the map manager restarted on the way."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from orograph import keys
from orograph.launch.in_process import build_rounds
from orograph.messages import RunEnd
from orograph.node import Node
from orograph.nodes.map_manager import MapManagerNode
from orograph.nodes.robot_mapping import RobotMappingNode
from orograph.nodes.world import WorldNode
from orograph.protocol.store import MemoryStore
from orograph.runtime.network import CUT, Spell, Weather
from orograph.scenario import Scenario
from orograph.scene.site import Site
from orograph.storage.recording import Recording
from orograph.storage.scenario_file import load_scenario

TINY = load_scenario("scenarios/tiny")
FOR_EVER = 100_000
STORM = Spell(Weather(loss=0.3, duplication=0.3, delay=0.3, delay_frames_max=10, reordering=0.3), 0, FOR_EVER)
FORECAST = (STORM, Spell(CUT, 100, 200, robots=("robot_001",)), Spell(CUT, 150, 250, robots=("robot_002",), down=False))
ROBOT_DIES, MANAGER_DIES = 210, 260


class Mission:
    """One mission played to its end."""

    def __init__(self, scenario: Scenario, out: Path) -> None:
        self._scenario, self._store = scenario, MemoryStore()
        with Recording(out, "in-process") as recording:
            self.rounds = build_rounds(scenario, self._store, recording, {}, FORECAST)
            self.end = self._play()

    def _play(self) -> RunEnd:
        world = self.node(keys.WORLD)
        assert isinstance(world, WorldNode)
        while world.ended is None:
            self.rounds.step()
            if self.rounds.frame == ROBOT_DIES:
                self._replace(
                    RobotMappingNode(Site(self._scenario), "robot_001", self._scenario.seed, b"second life".ljust(16))
                )
            if self.rounds.frame == MANAGER_DIES:
                self._replace(MapManagerNode(Site(self._scenario), self._scenario.robot_ids, self._store))
        return world.ended

    def node(self, name: str) -> Node:
        return next(node for node in self.rounds.nodes if node.name == name)

    def _replace(self, node: Node) -> None:
        self.rounds.nodes[[n.name for n in self.rounds.nodes].index(node.name)] = node

    @property
    def map_hash(self) -> bytes:
        return self.node(keys.MANAGER).artifacts()["glrm_hash"].tobytes()


@pytest.fixture(scope="module")
def mission(tmp_path_factory: pytest.TempPathFactory) -> Mission:
    return Mission(TINY, tmp_path_factory.mktemp("mission"))


def test_a_mission_in_bad_weather_ends_with_equal_copies(mission):
    assert mission.end.complete and mission.end.copies_equal
    manager = mission.node(keys.MANAGER).artifacts()
    assert manager["manager_epoch"] == 2, "the map manager was restarted"
    for robot in TINY.robot_ids:
        copy = mission.node(keys.node(keys.MAPPING, robot)).artifacts()["copy"]
        for name in ("height", "gradient_x", "gradient_y", "occupation", "confidence"):
            np.testing.assert_array_equal(copy[name], manager["glrm"][name])


def test_nothing_acknowledged_is_lost(mission):
    held = mission.node(keys.MANAGER).artifacts()["registers"]
    assert held["epoch"][held["robot"] == 1].max() == 2, "robot 1 was restarted"
    for number, robot in enumerate(TINY.robot_ids, start=1):
        acknowledged = mission.node(keys.node(keys.MAPPING, robot)).artifacts()["acknowledged"]
        own = held[held["robot"] == number]
        assert len(acknowledged) > 100
        for name in ("cell", "tick", "height", "gradient_x", "gradient_y", "occupation", "confidence"):
            np.testing.assert_array_equal(own[name], acknowledged[name])


def test_the_weather_was_bad(mission):
    for robot in TINY.robot_ids:
        told = mission.node(keys.node(keys.MAPPING, robot)).telemetry()
        assert told["batches_unanswered"] > 3 and told["copy_gaps"] > 3


def test_the_same_seed_gives_the_same_mission(mission, tmp_path):
    again = Mission(TINY, tmp_path / "again")
    assert again.map_hash == mission.map_hash and again.rounds.frame == mission.rounds.frame
