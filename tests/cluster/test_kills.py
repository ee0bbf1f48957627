"""Kill -9 in the middle of a mission of processes: it ends, nothing acknowledged is lost, all copies are equal."""

import os
import signal
from pathlib import Path

import pytest
from orograph.errors import RunError
from orograph.launch.lifecycle import finish, prepare_out
from orograph.launch.processes import run_processes
from orograph.launch.progress import Figures
from orograph.launch.supervisor import Child, Supervisor
from orograph.storage.results import Summary
from orograph.storage.run_folder import SUMMARY
from orograph.storage.scenario_file import load_scenario

pytestmark = pytest.mark.cluster
TINY = load_scenario("scenarios/tiny")


class Nemesis:
    """Kills one service at given frames of the world's clock."""

    def __init__(self, name: str, frames: list[int]) -> None:
        self._name, self._frames = name, frames
        self.kills = 0

    def started(self, supervisor: Supervisor) -> None:
        self._child: Child = next(c for c in supervisor.children if c.name == self._name)

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
    out, nemesis, kills = prepare_out(tmp_path / "run", TINY), Nemesis(name, frames), len(frames)
    run_processes(TINY, out, 1, (0, 0), nemesis.watch, nemesis.started)
    finish(TINY, out, "processes")
    summary = Summary.read(out)
    assert nemesis.kills == kills
    assert summary.complete and not summary.deterministic
    assert summary.cells_lost == 0 and summary.cells_acked > 100
    assert summary.copies_hash_equal and summary.glrm_is_own_fold


def test_the_worlds_death_ends_the_run_with_its_name(tmp_path: Path) -> None:
    out, nemesis = prepare_out(tmp_path / "run", TINY), Nemesis("world", [50])
    with pytest.raises(RunError, match=r"world died \(signal SIGKILL"):
        run_processes(TINY, out, 3, (0, 0), nemesis.watch, nemesis.started)
    assert not (out / SUMMARY).exists()
