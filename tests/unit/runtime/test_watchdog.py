"""The watchdog of a service, in a process of its own: a stuck loop ends with 70, a busy or turning one does not."""

import subprocess
import sys
from pathlib import Path

import pytest

PROGRAM = """
import os, sys, time
from orograph.runtime import watchdog as watchdog
watchdog.STUCK_S, watchdog.READY_EVERY_S = 0.3, 0.05
watched = watchdog.Watchdog("test", watchdog.options("").parse_args(["--ready-file", sys.argv[1]]))
{body}
time.sleep(0.2)
watchdog.leave(0 if {holds} else 1)
"""


def _code(tmp_path: Path, body: str, holds: str = "True") -> int:
    program = PROGRAM.format(body=body, holds=holds)
    return subprocess.run([sys.executable, "-c", program, str(tmp_path / "ready")], timeout=60).returncode


def test_a_stuck_process_ends_with_70(tmp_path: Path) -> None:
    assert _code(tmp_path, "watched.alive(); time.sleep(30)") == 70


@pytest.mark.parametrize("body", ["", "watched.alive(); watched.busy(); time.sleep(1)"])
def test_neither_a_process_that_has_not_begun_nor_a_busy_one_is_stuck(tmp_path: Path, body: str) -> None:
    assert _code(tmp_path, body) == 0


def test_only_a_ready_service_shows_it(tmp_path: Path) -> None:
    assert _code(tmp_path, "watched.alive(ready=False)", "not os.path.exists(sys.argv[1])") == 0
    assert _code(tmp_path, "watched.alive()", "os.path.exists(sys.argv[1])") == 0


def test_who_was_ready_stays_so_while_busy(tmp_path: Path) -> None:
    body = "watched.alive(); watched.busy(); os.remove(sys.argv[1])"
    assert _code(tmp_path, body, "os.path.exists(sys.argv[1])") == 0
    body = "os.remove(sys.argv[1]); watched.alive(ready=False); watched.busy()"
    assert _code(tmp_path, body, "not os.path.exists(sys.argv[1])") == 0


def test_an_exception_ends_the_process_with_70(tmp_path: Path) -> None:
    assert _code(tmp_path, "raise RuntimeError") == 70
    assert _code(tmp_path, "import threading; threading.Thread(target=lambda: 1 / 0).start(); time.sleep(30)") == 70
