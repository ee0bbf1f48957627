"""Who looks on leaves the mission as it is: a console that is killed, a recorder whose record makes the map again."""

import urllib.request
from pathlib import Path

import pytest
from orograph.launch.lifecycle import finish, prepare_out
from orograph.launch.processes import follow, free_port, started
from orograph.launch.progress import Figures
from orograph.record.reading import read_record
from orograph.record.rerun import rerun
from orograph.storage.results import Summary
from orograph.storage.scenario_file import load_scenario

pytestmark = pytest.mark.cluster
TINY = load_scenario("scenarios/tiny")


def test_seen_and_recorded_and_with_its_console_killed_the_map_is_the_same(in_process: Summary, tmp_path: Path) -> None:
    out, port, pages = prepare_out(tmp_path / "run", TINY), free_port(), []
    with started(TINY, out, 3, page_port=port, record=True) as (supervisor, sim):
        console = next(child for child in supervisor.children if child.name == "console")

        def look_then_kill(figures: Figures, restarts: list[str]) -> None:
            if not pages and figures.get("world", {}).get("frame", 0) > 100:
                pages.append(urllib.request.urlopen(f"http://127.0.0.1:{port}", timeout=30).read())
                console.process.kill()

        follow(supervisor, sim, out, look_then_kill)
        restarts = supervisor.restarts
    finish(TINY, out, "processes")
    summary = Summary.read(out)
    assert restarts and restarts[0] == "console (signal SIGKILL)" and b"<html" in pages[0][:500]
    record = read_record(out / "record-001.mcap")
    assert record.whole and rerun([record]).reached_hash == in_process.glrm_hash
    assert summary.deterministic and summary.complete and summary.glrm_hash == in_process.glrm_hash
