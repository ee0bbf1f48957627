"""A robot is revoked in the middle of a mission of processes, and the manager that did it is killed."""

from pathlib import Path

import numpy as np
import pytest
from orograph import keys
from orograph.cli.main import main
from orograph.launch.lifecycle import finish, prepare_out
from orograph.launch.processes import follow, started
from orograph.launch.progress import Figures
from orograph.storage.parts import read_parts
from orograph.storage.results import Summary
from orograph.storage.scenario_file import load_scenario
from ports import free_port

pytestmark = pytest.mark.cluster
PACED = load_scenario("scenarios/tiny").model_copy(update={"time_scale": 6.0})
REVOKED_AT, KILLED_AT = 150, 200
"""Frames of the world's clock."""


def test_a_revoked_robot_is_out_for_good_and_the_mission_goes_on(tmp_path: Path) -> None:
    out, port = prepare_out(tmp_path / "run", PACED), free_port()
    codes: list[int] = []
    with started(PACED, out, 1, (0, port)) as (supervisor, sim):
        manager = next(child for child in supervisor.children if child.name == keys.MANAGER)

        def watch(figures: Figures, restarts: list[str]) -> None:
            frame = figures.get(keys.WORLD, {}).get("frame", 0)
            if frame >= REVOKED_AT and not codes:
                codes.append(main(["revoke", "robot_002", "--router", f"tcp/127.0.0.1:{port}"]))
            if frame >= KILLED_AT and len(codes) == 1:
                manager.process.kill()
                codes.append(0)

        follow(supervisor, sim, out, watch)
    finish(PACED, out, "processes")
    summary, held = Summary.read(out), read_parts(out).of(keys.MANAGER)
    assert codes == [0, 0] and summary.robots_revoked == ("robot_002",) and not summary.deterministic
    assert np.unique(held["registers"]["robot"]).tolist() == [1] and held["revoked"].tolist() == [2]
    assert summary.complete and summary.copies_hash_equal and summary.glrm_is_own_fold and summary.cells_lost == 0
