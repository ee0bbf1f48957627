"""Thirty-two processes ask for robots at once, twenty times: every robot has one holder, the others wait as spares."""

from __future__ import annotations

import multiprocessing
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import pytest
from contract import claimant
from orograph import keys
from orograph.comms.bus import Bus
from orograph.runtime.claims import Claims
from polling import until

pytestmark = [pytest.mark.cluster, pytest.mark.timeout(600)]
ROBOTS = tuple(keys.robot_id(i + 1) for i in range(10))
WORKERS, ROUNDS = 32, 20
STOP = threading.Event()
PROCESSES = multiprocessing.get_context("forkserver")
PROCESSES.set_forkserver_preload(["contract.claimant"])


@contextmanager
def workers(endpoint: str, round_: int) -> Iterator[Any]:
    """All of them, ready to ask at one moment; gives the queue of what they are granted."""
    together, told = PROCESSES.Barrier(WORKERS), PROCESSES.Queue()
    crowd = [
        PROCESSES.Process(target=claimant.work, args=(endpoint, f"worker{i}-{round_}", together, told))
        for i in range(WORKERS)
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
            with workers(endpoint, round_) as told:
                said: dict[str, tuple[str, ...]] = {}
                while len(said) < WORKERS or sum(map(bool, said.values())) < len(ROBOTS):
                    said.update([told.get(timeout=60)])  # a robot, or that it is a spare; a spare may get one yet
                held = sorted(robot for robots in said.values() for robot in robots)
                assert held == list(ROBOTS), f"round {round_}"
                until(lambda: sorted(r for robots in alive.values() for r in robots) == list(ROBOTS), "not all tokens")
                assert told.empty(), f"round {round_}: {told.get()} when all were held"
            until(lambda: not alive, "tokens of the dead stay")
