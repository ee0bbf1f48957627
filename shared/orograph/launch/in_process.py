"""A mission in this process: the same nodes over the seeded network, for tests and studies."""

from __future__ import annotations

import time
from collections.abc import Sequence
from contextlib import closing
from pathlib import Path

from orograph import keys
from orograph.comms import wire
from orograph.launch.progress import OnProgress
from orograph.node import Node
from orograph.nodes.laser import LaserNode
from orograph.nodes.map_manager import MapManagerNode
from orograph.nodes.navigator import NavigatorNode
from orograph.nodes.orchestrator import OrchestratorNode
from orograph.nodes.robot_mapping import RobotMappingNode
from orograph.nodes.world import WorldNode
from orograph.protocol.store import Store
from orograph.runtime.network import Network, Spell
from orograph.runtime.rounds import Rounds
from orograph.scenario import Scenario
from orograph.scene.site import Site
from orograph.sensing import View
from orograph.stages import StageRecorder
from orograph.storage.recording import Recording
from orograph.storage.results import WorldResult
from orograph.storage.run_folder import STORE
from orograph.storage.sqlite_store import SqliteStore

SHOW_EVERY_S = 0.3


def build_rounds(
    scenario: Scenario, store: Store, recording: Recording, stages: dict[str, StageRecorder],
    forecast: Sequence[Spell] = (),
) -> Rounds:  # fmt: skip
    """All nodes of a run in the radio's `forecast` weather; stage recorders are added to `stages`."""
    site, robots = Site(scenario), scenario.robot_ids
    view = View(site, len(robots))
    mapping = [keys.node(keys.MAPPING, r) for r in robots]
    stages.update({name: StageRecorder(time.perf_counter_ns) for name in (keys.MANAGER, *mapping)})
    nodes: list[Node] = [
        MapManagerNode(site, robots, store, stages[keys.MANAGER]),
        OrchestratorNode(site, robots, scenario.seed),
        *(LaserNode(view, r, scenario.seed, robots) for r in robots),
        *(NavigatorNode(site, r, scenario.seed) for r in robots),
        *(
            RobotMappingNode(site, r, scenario.seed, r.encode().ljust(16, b"\0"), stages[name])
            for r, name in zip(robots, mapping, strict=True)
        ),
    ]
    world = WorldNode(scenario, robots, scenario.seed)
    nodes.append(world)
    network = Network(
        scenario, [n.name for n in nodes], world.radio_up, forecast,
        lambda message: len(wire.encode(message)) + wire.HEADER.size,
    )  # fmt: skip
    return Rounds(scenario.frame_ns, nodes, network, recording.note)


def run_in_process(scenario: Scenario, out: Path, on_progress: OnProgress) -> None:
    """Run the mission whose resolved scenario is in out/parts to its end."""
    store = SqliteStore(out / STORE, scenario.grid.grid.shape)
    with closing(store), Recording(out, "in-process") as recording:
        _run(scenario, store, recording, on_progress)


def _run(scenario: Scenario, store: SqliteStore, recording: Recording, on_progress: OnProgress) -> None:
    stages: dict[str, StageRecorder] = {}
    rounds = build_rounds(scenario, store, recording, stages)
    begin_s = shown_s = time.monotonic()
    world = next(n for n in rounds.nodes if isinstance(n, WorldNode))
    while world.ended is None:
        rounds.step()
        if time.monotonic() - shown_s > SHOW_EVERY_S:
            shown_s = time.monotonic()
            on_progress({n.name: dict(n.telemetry()) for n in rounds.nodes}, [])
    network = rounds.network
    for node in rounds.nodes:
        recording.save(node)
    for name, recorder in stages.items():
        recording.save_stages(name, recorder)
    recording.save_bytes(network.bytes_up, network.bytes_down)
    wall_time_s = time.monotonic() - begin_s
    recording.save_result(WorldResult.of(rounds.stamp_ns, wall_time_s, world.ended, deterministic=True))
