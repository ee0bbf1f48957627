"""Kill -9 in the middle of a mission of processes: it ends, nothing acknowledged is lost, all copies are equal."""

import os
import signal
from pathlib import Path

import pytest
from orograph.errors import RunError
from orograph.launch.lifecycle import finish, prepare_out
from orograph.launch.processes import follow, started
from orograph.launch.progress import Figures
from orograph.launch.supervisor import Supervisor
from orograph.storage.results import Summary
from orograph.storage.run_folder import SUMMARY
from orograph.storage.scenario_file import load_scenario

pytestmark = pytest.mark.cluster
TINY = load_scenario("scenarios/tiny")
PACED = TINY.model_copy(update={"time_scale": 6.0})
"""Lockstep runs through the rest of the mission and its flush while a killed service still starts."""


class Nemesis:
    """Kills one service at given frames of the world's clock."""

    def __init__(self, supervisor: Supervisor, name: str, frames: list[int]) -> None:
        self._child = next(c for c in supervisor.children if c.name == name)
        self._frames = frames
        self.kills = 0

    def watch(self, figures: Figures, restarts: list[str]) -> None:
        frame = figures.get("world", {}).get("frame", 0)
        if self._frames and frame >= self._frames[0] and self._child.process.poll() is None:
            self._frames.pop(0)
            os.kill(self._child.process.pid, signal.SIGKILL)
            self.kills += 1


@pytest.mark.parametrize(
    ("name", "frames"), [("map-manager", [150, 300]), ("robot-mapping-1", [200]), ("router-radio", [200])]
)
def test_a_killed_part_costs_nothing_that_was_acknowledged(name: str, frames: list[int], tmp_path: Path) -> None:
    out, kills = prepare_out(tmp_path / "run", PACED), len(frames)
    with started(PACED, out, 1) as (supervisor, sim):
        nemesis = Nemesis(supervisor, name, frames)
        follow(supervisor, sim, out, nemesis.watch)
    finish(PACED, out, "processes")
    summary = Summary.read(out)
    assert nemesis.kills == kills
    assert summary.complete and not summary.deterministic
    assert summary.cells_lost == 0 and summary.cells_acked > 100
    assert summary.copies_hash_equal and summary.glrm_is_own_fold


def test_the_worlds_death_ends_the_run_with_its_name(tmp_path: Path) -> None:
    out = prepare_out(tmp_path / "run", TINY)
    with started(TINY, out, 3) as (supervisor, sim), pytest.raises(RunError, match=r"world died \(signal SIGKILL"):
        follow(supervisor, sim, out, Nemesis(supervisor, "world", [50]).watch)
    assert not (out / SUMMARY).exists()
