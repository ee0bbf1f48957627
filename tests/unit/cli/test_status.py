"""What `orograph status` shows of a cluster, of none, and of what is no cluster."""

from __future__ import annotations

import json
import threading
from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import Any

import msgpack
import numpy as np
import pytest
from orograph import keys
from orograph.cli import status
from orograph.cli.main import main
from orograph.comms import wire
from orograph.comms.bus import Bus
from orograph.control import ClusterStatus, HeldMap
from orograph.messages import ManagerStatus, MappingStatus, RobotStatus
from orograph.nodes.status_board import StatusBoard
from polling import until
from ports import free_port
from rich.console import Console

S = 1_000_000_000
ROBOTS = ("robot_001", "robot_002")
WORKERS = {"laser": "a1b2c3", "robot-mapping": "d4e5f6", "navigator": "0718293a"}


def drive(state: str) -> RobotStatus:
    none = np.zeros(0, "<u2")
    return RobotStatus(0, 1, none, none, state, 3.0, 4.0)


class Left:
    """A patrol with waypoints left."""

    def open(self) -> list[int]:
        return [0] * 5

    def left(self, robot: str) -> list[int]:
        return [0] * 2


def standing() -> ClusterStatus:
    """robot_001 is well, robot_002's radio went 12 s ago and nobody is its laser."""
    board = StatusBoard(ROBOTS, "tiny", 1000)
    for robot, heard_ns, version, held in (("robot_001", 20 * S, 7, b"m"), ("robot_002", 8 * S, 4, b"o")):
        board.hear(robot, drive("driving"), heard_ns)
        board.hear(robot, MappingStatus(heard_ns, False, 31, version, held * 16), heard_ns)
    board.hear("", ManagerStatus(20 * S, 7, b"m" * 16, 250, np.zeros(0, "<u2")), 20 * S)
    without_laser = {s: i for s, i in WORKERS.items() if s != "laser"}
    told = board.status(20 * S, "mapping", Left())
    return told.of_run("tiny-001", {"robot_001": WORKERS, "robot_002": without_laser})


def shown(told: ClusterStatus) -> list[str]:
    console = Console(width=100)
    with console.capture() as capture:
        console.print(status.view(told))
    return capture.get().splitlines()


def test_the_table_says_what_each_robot_is_up_to() -> None:
    lines = shown(standing())
    head = " ".join(line.strip() for line in lines[: lines.index("")])
    assert head.startswith("tiny-001") and "25.0%" in head and "version 7, 6d6d6d" in head and "mapping" in head
    one, two = (next(line for line in lines if line.startswith(r)).split() for r in ROBOTS)
    assert one[1:] == ["a1b2", "d4e5", "0718", "up", "driving", "2", "31", "7", "6d6d6d", "equal"]
    assert two[1:] == ["none", "d4e5", "0718", "down", "12", "s", "driving", "2", "31", "4", "6f6f6f", "behind"]


def test_the_table_fits_a_terminal_of_80_columns() -> None:
    console = Console(width=80)
    with console.capture() as capture:
        console.print(status.view(standing()))
    assert sum(line.startswith("robot_") for line in capture.get().splitlines()) == 2
    assert "…" not in capture.get()


@pytest.mark.parametrize(
    ("version", "digest", "word"),
    [(7, "6d" * 16, "equal"), (7, "00" * 16, "DIFFERS"), (6, "00" * 16, "behind"), (8, "00" * 16, "newer")],
)
def test_a_copy_is_judged_by_version_and_hash(version: int, digest: str, word: str) -> None:
    manager = HeldMap(silent_s=0, version=7, hash="6d" * 16)
    assert status.agreement(HeldMap(silent_s=0, version=version, hash=digest), manager).plain.split()[1] == word


def test_one_silent_service_is_named() -> None:
    robot = standing().robots[0]
    never = replace(robot, drive_silent_s=None, copy_held=None)
    assert status.link(robot).plain == "up"
    assert status.link(replace(robot, drive_silent_s=3.0)).plain == "navigator down 3 s"
    assert status.link(never).plain == "never heard"


# --- over a real router -------------------------------------------------------------------------------------------


@pytest.fixture
def cluster(router: str) -> Iterator[Callable[[Any], None]]:
    """Somebody who answers with whatever it is given."""
    starting = StatusBoard(ROBOTS, "tiny", 1000).status(0, "starting", None)
    answers: list[Any] = [starting]
    stop = threading.Event()
    with Bus.open(router, router, stop) as bus:
        session = bus.sessions[keys.RADIO]

        def reply(query: Any) -> None:
            with query:
                told = answers[0]
                query.reply(keys.STATUS, told if isinstance(told, bytes) else wire.encode(told))

        session.declare_queryable(keys.STATUS, reply)
        until(lambda: bus.ask(keys.STATUS, None, ClusterStatus, 5.0, keys.RADIO) is not None, "nobody answers")
        yield lambda answer: answers.__setitem__(0, answer)


def line(capsys: pytest.CaptureFixture[str], code: int, *argv: str) -> str:
    assert main(["status", *argv]) == code
    out, err = capsys.readouterr()
    assert not out and err.startswith("orograph: ") and err.count("\n") == 1
    return err


def test_a_cluster_is_asked_over_zenoh(
    router: str, cluster: Callable[[Any], None], capsys: pytest.CaptureFixture[str]
) -> None:
    cluster(standing())
    assert main(["status", "--router", router, "--json"]) == 0
    told = capsys.readouterr().out
    assert json.loads(told) == json.loads(status.as_json(standing()))
    assert json.loads(told)["robots"][0]["workers"] == WORKERS
    assert main(["status", "--router", router]) == 0
    assert "robot_002" in capsys.readouterr().out


def test_watching_asks_again_until_interrupted(
    router: str, cluster: Callable[[Any], None], capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    turns: list[float] = []

    def pause(seconds: float) -> None:
        turns.append(seconds)
        cluster(replace(standing(), sim_time_s=20.0 + len(turns)))
        if len(turns) == 3:
            raise KeyboardInterrupt

    monkeypatch.setattr(status.time, "sleep", pause)
    cluster(standing())
    assert main(["status", "--router", router, "--watch", "--json"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert [json.loads(text)["sim_time_s"] for text in lines] == [20.0, 21.0, 22.0] and set(turns) == {1.0}


def test_nobody_there_is_one_line(capsys: pytest.CaptureFixture[str]) -> None:
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    assert f"no router answers at {endpoint}" in line(capsys, 1, "--router", endpoint)


def test_a_router_without_a_cluster_is_one_line(router: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert "no orchestrator answers" in line(capsys, 1, "--router", router)


def test_a_cluster_that_starts_is_one_line(
    router: str, cluster: Callable[[Any], None], capsys: pytest.CaptureFixture[str]
) -> None:
    assert "starting" in line(capsys, 1, "--router", router)


@pytest.mark.parametrize("answer", [b"", b"x", *map(msgpack.packb, (7, [1, {}], [1, {"phase": "x"}], [2, {}]))])
def test_an_answer_of_something_else_is_one_line(
    router: str, cluster: Callable[[Any], None], capsys: pytest.CaptureFixture[str], answer: bytes
) -> None:
    cluster(answer)
    assert "no orchestrator of this program's version" in line(capsys, 1, "--router", router)


@pytest.mark.parametrize("endpoint", ["127.0.0.1:7447", "tcp/7447", "tcp/h:0", "tcp/h:x", "udp/h:7447", ""])
def test_what_is_no_endpoint_is_one_line(capsys: pytest.CaptureFixture[str], endpoint: str) -> None:
    assert "expected tcp/HOST:PORT" in line(capsys, 2, "--router", endpoint)
