"""Who has the book alone can take part: a mapper made from docs/messages.json joins and brings a record home."""

from __future__ import annotations

import ast
import threading
from collections.abc import Callable
from contextlib import ExitStack
from pathlib import Path

from contract import foreign_mapper
from contract.chatter import SCENARIO, Chatter, Stop, make_clock
from contract.conftest import free_endpoint
from contract.foreign_mapper import ForeignMapper
from orograph import keys
from orograph.comms.bus import Bus
from orograph.nodes.map_manager import MapManagerNode
from orograph.protocol.store import MemoryStore
from orograph.runtime import briefing
from orograph.runtime.claims import Claims
from orograph.runtime.host import NodeHost
from orograph.runtime.participant import Participant, Ticks
from orograph.scene.site import Site
from orograph.storage.recording import Recording

STOP = threading.Event()
ME = "robot-mapping/robot_001"


def test_it_knows_none_of_our_code() -> None:
    tree = ast.parse(Path(foreign_mapper.__file__).read_text())
    names = {n.name for node in ast.walk(tree) if isinstance(node, ast.Import) for n in node.names}
    names |= {str(node.module) for node in ast.walk(tree) if isinstance(node, ast.ImportFrom)}
    assert not any(name.startswith(("orograph", "services", "contract")) for name in names)


def test_a_mapper_made_from_the_book_brings_its_evidence_home(
    start_router: Callable[..., object], tmp_path: Path
) -> None:
    sim, radio = free_endpoint(), free_endpoint()
    start_router(sim)
    start_router(radio)
    watchdog, world = Stop(), Chatter(keys.WORLD)
    manager = MapManagerNode(Site(SCENARIO), SCENARIO.robot_ids, MemoryStore())
    with ExitStack() as stack:
        recording = stack.enter_context(Recording(tmp_path, "all"))
        bus, own, foreign = (stack.enter_context(Bus.open(sim, radio, STOP)) for _ in range(3))
        Claims(SCENARIO.robot_ids, lambda fleet: None).attend(bus)
        briefing.answer(bus, briefing.Briefing(SCENARIO, tmp_path))
        stack.enter_context(own.token(keys.MANAGER, "manager", ()))
        host = NodeHost(own, [manager], SCENARIO, recording)
        serving = Participant(own, host, "manager", SCENARIO, watchdog, Ticks(own))
        mapper = ForeignMapper(foreign.sessions[keys.SIM], foreign.sessions[keys.RADIO])
        assert mapper.join()["name"] == SCENARIO.name and mapper.robot == "robot_001"
        world.goal = 60
        clock = make_clock(bus, world, watchdog, recording, [keys.MANAGER, ME])
        threads = [threading.Thread(target=run, daemon=True) for run in (serving.run, mapper.run)]
        for thread in threads:
            thread.start()
        clock.await_start()
        clock.run()
        for thread in threads:
            thread.join(10)
            assert not thread.is_alive()
    assert mapper.epoch == 1 and mapper.acked["cell"].tolist() == [7] and mapper.acked["seq"].tolist() == [1]
    (register,) = manager.artifacts()["registers"]
    assert (register["robot"], register["cell"], register["height"]) == (1, 7, 1234)
    assert clock.lost == 0 and clock.deterministic
