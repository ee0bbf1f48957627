"""The supervisor restarts what dies, names what keeps dying, and leaves no process behind."""

import os
import time
from pathlib import Path

import pytest
from orograph.errors import RunError
from orograph.launch.supervisor import Supervisor


@pytest.fixture
def environment(tmp_path: Path) -> dict[str, str]:
    (tmp_path / "lives.py").write_text("import sys; sys.stdin.read()")
    (tmp_path / "dies.py").write_text("print('no luck today'); raise SystemExit(3)")
    (tmp_path / "ends.py").write_text("")
    return {**os.environ, "PYTHONPATH": str(tmp_path)}


def _poll_until(supervisor: Supervisor, done: object, seconds: float = 20) -> None:
    deadline = time.monotonic() + seconds
    while not done():
        assert time.monotonic() < deadline
        supervisor.poll()
        time.sleep(0.02)


def test_a_killed_service_is_started_again_and_all_end(environment: dict[str, str], tmp_path: Path) -> None:
    with Supervisor(environment, tmp_path / "logs") as supervisor:
        child = supervisor.start("one", "lives")
        first = child.process.pid
        child.process.kill()
        _poll_until(supervisor, lambda: child.process.pid != first)
        assert supervisor.restarts == ["one (signal SIGKILL)"]
        second = child.process
    assert second.poll() is not None


def test_a_service_that_keeps_dying_ends_the_run_with_its_last_words(
    environment: dict[str, str], tmp_path: Path
) -> None:
    with Supervisor(environment, tmp_path / "logs") as supervisor:
        child = supervisor.start("one", "dies")
        with pytest.raises(RunError, match=r"one died.*exit code 3.*4 times(.|\n)*no luck today"):
            _poll_until(supervisor, lambda: False)
    assert len(child.deaths_s) == 4


def test_all_services_ended_well_is_the_end(environment: dict[str, str], tmp_path: Path) -> None:
    with Supervisor(environment, tmp_path / "logs") as supervisor:
        supervisor.start("router-sim", "lives")
        supervisor.start("one", "ends")
        deadline = time.monotonic() + 20
        while not supervisor.poll():
            assert time.monotonic() < deadline
            time.sleep(0.02)


def test_one_that_stands_aside_may_die_as_often_as_it_likes_and_nobody_waits_for_it(
    environment: dict[str, str], tmp_path: Path
) -> None:
    with Supervisor(environment, tmp_path / "logs") as supervisor:
        supervisor.start("one", "lives")
        aside = supervisor.start("aside", "dies", aside=True)
        _poll_until(supervisor, lambda: aside.gone)
        assert len(aside.deaths_s) == 4 and "the run goes on" in supervisor.restarts[-1]
    with Supervisor(environment, tmp_path / "logs") as supervisor:
        supervisor.start("one", "ends")
        supervisor.start("aside", "lives", aside=True)
        deadline = time.monotonic() + 20
        while not supervisor.poll():
            assert time.monotonic() < deadline
            time.sleep(0.02)
