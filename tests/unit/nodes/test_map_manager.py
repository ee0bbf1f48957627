"""The map-manager node: what goes over which plane to whom, and what it leaves behind."""

from __future__ import annotations

import numpy as np
import pytest
from orograph import keys
from orograph.messages import UPDATE, Ack, Batch, Delta, Digest, Envelope, Frame, Hello, ManagerStatus, Welcome
from orograph.nodes.map_manager import MapManagerNode
from orograph.protocol.fold import fold_registers
from orograph.protocol.store import MemoryStore
from orograph.protocol.tiles import map_hash
from orograph.rules import Rules
from orograph.scenario import GridSpec, Scenario, Start
from orograph.scene.site import Site

SCENARIO = Scenario(
    name="flat", title="flat", grid=GridSpec(rows=8, cols=8), starts=(Start(x_m=5, y_m=5),), base_station_m=(5, 5),
    patrol=((20.0, 20.0),), robots=1,
)  # fmt: skip
ROBOT = "robot_001"
MAPPING, ORCHESTRATOR = keys.node(keys.MAPPING, ROBOT), keys.node(keys.ORCHESTRATOR)


class Played:
    def __init__(self, store):
        self.node = MapManagerNode(Site(SCENARIO), (ROBOT,), store)
        self.frame, self.sent, self.notes = 0, [], []

    def step(self, *messages, sender=MAPPING):
        inbox = [Envelope(keys.RADIO, keys.MANAGER, sender, self.frame, i, m) for i, m in enumerate(messages)]
        frame = Frame(self.frame, self.frame * 100_000_000, 100_000_000)
        self.node.step(
            frame, inbox, lambda *args: self.sent.append(args), lambda kind, fields: self.notes.append((kind, fields))
        )
        self.frame += 1

    def take(self, kind):
        return [(plane, to, m) for plane, to, m in self.sent if isinstance(m, kind)]


def records() -> np.ndarray:
    out = np.zeros(2, UPDATE)
    out["cell"], out["seq"], out["height"], out["confidence"] = [9, 10], [1, 2], 400, 120
    return out


@pytest.fixture
def played():
    manager = Played(MemoryStore())
    manager.step(Hello(b"n" * 16))
    manager.step(Batch(1, records()))
    for _ in range(11):
        manager.step()
    return manager


def test_answers_go_to_the_robot_and_beats_to_all(played):
    assert {(plane, to) for plane, to, _ in played.take(Welcome) + played.take(Ack)} == {(keys.RADIO, MAPPING)}
    everyone = {(keys.RADIO, keys.group(keys.MAPPING))}
    assert {(plane, to) for plane, to, _ in played.take(Delta) + played.take(Digest)} == everyone
    assert ("hello", {"robot": ROBOT, "epoch": 1}) in played.notes


def test_status_every_second_with_the_hash(played):
    statuses = played.take(ManagerStatus)
    assert [m.stamp_ns for _, _, m in statuses] == [0, 1_000_000_000]
    assert statuses[0][2].glrm_hash != statuses[1][2].glrm_hash
    plane, to, status = statuses[-1]
    assert (plane, to) == (keys.RADIO, ORCHESTRATOR)
    assert status.glrm_hash == map_hash(played.node.artifacts()["glrm"]) and status.confident_cells == 2


def test_artifacts_fold_to_the_map(played):
    left = played.node.artifacts()
    folded = fold_registers(left["prior"], left["registers"], Rules.of(SCENARIO.rules))
    assert map_hash(folded) == map_hash(left["glrm"]) == left["glrm_hash"].tobytes()
    assert left["registers"]["robot"].tolist() == [1, 1] and left["registers"]["epoch"].tolist() == [1, 1]
    assert left["first_confident_ns"][[9, 10, 11]].tolist() == [100_000_000, 100_000_000, -1]
    assert left["coverage"].tolist() == [(0, 0, 0), (1_000_000_000, 2, 1)] and left["acked_records"].tolist() == [2]


def test_restart_over_the_same_store_brings_the_same_map():
    store = MemoryStore()
    first = Played(store)
    first.step(Hello(b"n" * 16))
    first.step(Batch(1, records()))
    again = Played(store)
    assert np.array_equal(first.node.artifacts()["registers"], again.node.artifacts()["registers"])
    assert first.node.artifacts()["glrm_hash"].tolist() == again.node.artifacts()["glrm_hash"].tolist()
