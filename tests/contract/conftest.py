"""Real routers in processes of their own, on free loopback ports."""

import subprocess
import sys
from collections.abc import Callable, Iterator

import pytest
from ports import free_port


def free_endpoint() -> str:
    return f"tcp/127.0.0.1:{free_port()}"


@pytest.fixture
def start_router() -> Iterator[Callable[..., subprocess.Popen[bytes]]]:
    started: list[subprocess.Popen[bytes]] = []

    def start(endpoint: str, *peers: str) -> subprocess.Popen[bytes]:
        links = [word for peer in peers for word in ("--peer", peer)]
        command = [sys.executable, "-m", "services.router", "--listen", endpoint, *links]
        started.append(subprocess.Popen(command))
        return started[-1]

    yield start
    for process in started:
        process.kill()
        process.wait()


@pytest.fixture
def endpoint(start_router: Callable[..., subprocess.Popen[bytes]]) -> str:
    address = free_endpoint()
    start_router(address)
    return address
