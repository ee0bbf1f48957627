"""Thirty-two workers ask for robots at once, twenty times: every robot has one holder, the others wait as spares."""

import socket
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack

import pytest
from orograph import keys
from orograph.edge import wire
from orograph.edge.bus import Bus
from orograph.edge.claims import Claims

pytestmark = pytest.mark.cluster
ROBOTS = tuple(keys.robot_id(i + 1) for i in range(10))
WORKERS, ROUNDS = 32, 20
STOP = threading.Event()


@pytest.fixture
def endpoint() -> Iterator[str]:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        address = f"tcp/127.0.0.1:{probe.getsockname()[1]}"
    router = subprocess.Popen([sys.executable, "-m", "services.router", "--listen", address])
    yield address
    router.kill()
    router.wait()


class Worker:
    """A session of its own that claims, shows its token and dies: what a service does before it builds its nodes."""

    def __init__(self, endpoint: str, stack: ExitStack, number: int) -> None:
        self._bus, self._number = stack.enter_context(Bus.open(endpoint, None, STOP)), number

    def claim(self, round_: int, together: threading.Barrier, granted: list[str]) -> tuple[str, ...]:
        """Ask again, as a spare does, until this one has a robot or every robot is held."""
        instance = f"worker{self._number}-{round_}"
        question = {"service": keys.LASER, "instance": instance, "capacity": 1, "wanted": []}
        together.wait(30)
        robots: tuple[str, ...] = ()
        while not robots and len(granted) < len(ROBOTS):
            reply = self._bus.ask(keys.CLAIM, wire.pack_plain(question), 10.0)  # None: the router knows of nobody yet
            robots = tuple(wire.unpack_plain(reply)["robots"]) if reply is not None else ()
            granted.extend(robots)
        self._token = self._bus.token(keys.LASER, instance, robots) if robots else None
        return robots

    def die(self) -> None:
        if self._token is not None:
            self._token.undeclare()


def test_ids_are_unique_under_any_order_of_starts(endpoint: str) -> None:
    with ExitStack() as stack, ThreadPoolExecutor(WORKERS) as pool:
        server = stack.enter_context(Bus.open(endpoint, None, STOP))
        alive: set[str] = set()
        server.watch_alive(lambda s, instance, robots, up: (alive.add if up else alive.discard)(instance))
        Claims(ROBOTS, lambda fleet: None).attend(server)
        workers = list(pool.map(lambda i: Worker(endpoint, stack, i), range(WORKERS)))
        for round_ in range(ROUNDS):
            together, granted = threading.Barrier(WORKERS), list[str]()
            grants = list(pool.map(lambda w, r=round_, t=together, g=granted: w.claim(r, t, g), workers))
            assert sorted(robot for grant in grants for robot in grant) == list(ROBOTS), f"round {round_}"
            assert sum(not grant for grant in grants) == WORKERS - len(ROBOTS)
            _until(lambda: len(alive) == len(ROBOTS))
            list(pool.map(Worker.die, workers))
            _until(lambda: not alive)


def _until(condition, seconds: float = 20) -> None:
    deadline = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < deadline
        time.sleep(0.01)
