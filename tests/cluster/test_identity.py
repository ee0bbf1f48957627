"""Thirty-two processes ask for robots at once, twenty times: every robot has one holder, the others wait as spares."""

from __future__ import annotations

import multiprocessing
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import pytest
from orograph import keys
from orograph.edge import wire
from orograph.edge.bus import Bus
from orograph.edge.claims import Claims

pytestmark = [pytest.mark.cluster, pytest.mark.timeout(600)]
ROBOTS = tuple(keys.robot_id(i + 1) for i in range(10))
WORKERS, ROUNDS = 32, 20
STOP = threading.Event()
PROCESSES = multiprocessing.get_context("forkserver")
PROCESSES.set_forkserver_preload(["orograph.edge.bus"])


@pytest.fixture
def endpoint() -> Iterator[str]:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        address = f"tcp/127.0.0.1:{probe.getsockname()[1]}"
    router = subprocess.Popen([sys.executable, "-m", "services.router", "--listen", address])
    yield address
    router.kill()
    router.wait()


def work(endpoint: str, instance: str, together: Any, told: Any) -> None:
    """What a service does before it builds its nodes: claim, show its token, or wait as a spare; until it is killed."""
    question = wire.pack_plain({"service": keys.LASER, "instance": instance, "capacity": 1, "wanted": []})
    with Bus.open(endpoint, None, STOP) as bus:
        together.wait(60)
        robots: list[str] | None = None
        while not robots:
            reply = bus.ask(keys.CLAIM, question, 10.0)
            if reply is not None and (granted := wire.unpack_plain(reply)["robots"]) != robots:
                robots = granted
                told.put((instance, tuple(granted)))
        token = bus.token(keys.LASER, instance, tuple(robots))
        STOP.wait()
        token.undeclare()


@contextmanager
def workers(endpoint: str, round_: int) -> Iterator[Any]:
    """All of them, ready to ask at one moment; gives the queue of what they are granted."""
    together, told = PROCESSES.Barrier(WORKERS), PROCESSES.Queue()
    crowd = [
        PROCESSES.Process(target=work, args=(endpoint, f"worker{i}-{round_}", together, told)) for i in range(WORKERS)
    ]
    for process in crowd:
        process.start()
    try:
        yield told
    finally:
        for process in crowd:
            process.kill()
        for process in crowd:
            process.join()


def test_ids_are_unique_under_any_order_of_starts(endpoint: str) -> None:
    with Bus.open(endpoint, None, STOP) as server:
        alive: dict[str, tuple[str, ...]] = {}
        server.watch_alive(lambda s, i, robots, up: alive.update({i: robots}) if up else alive.pop(i, None))
        Claims(ROBOTS, lambda fleet: None).attend(server)
        for round_ in range(ROUNDS):
            grants: list[tuple[str, ...]] = []
            with workers(endpoint, round_) as told:
                while len(grants) < WORKERS:  # each has one, or was refused while all were held
                    grants.append(told.get(timeout=60)[1])
                held = sorted(robot for grant in grants for robot in grant)
                assert held == list(ROBOTS), f"round {round_}"
                until(lambda: sorted(r for robots in alive.values() for r in robots) == list(ROBOTS))
                assert told.empty(), f"round {round_}: {told.get()} after all were held"
            until(lambda: not alive)


def until(condition: Callable[[], bool], seconds: float = 20) -> None:
    deadline = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < deadline
        time.sleep(0.01)
