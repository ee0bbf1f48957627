"""What a run of processes shows to those who watch it, and how it comes by its ports."""

import itertools
import socket
import threading
from pathlib import Path

import pytest
from orograph.errors import InputError
from orograph.launch import processes
from orograph.launch.processes import held_endpoint
from orograph.launch.progress import Figures
from orograph.storage.run_folder import WORLD, write_whole


class Turns:
    """In the place of a supervisor: all services end after so many polls."""

    restarts = ()

    def __init__(self, left: int) -> None:
        self.left = left

    def poll(self) -> bool:
        self.left -= 1
        return self.left < 0


def test_figures_may_be_read_while_more_come(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, fine_switching: None
) -> None:
    def listen(_: str, figures: Figures, stop: threading.Event) -> None:
        for i in itertools.count():
            if stop.is_set():
                return
            figures[f"laser/{i % 100_000}"] = {}

    monkeypatch.setattr(processes, "_listen", listen)
    monkeypatch.setattr(processes, "POLL_S", 0.0)
    write_whole(tmp_path / WORLD, "{}")
    seen: list[int] = []
    processes.follow(Turns(50), "", tmp_path, lambda figures, _: seen.append(sum(1 for _ in figures)))
    assert len(seen) == 50 and seen[-1] > 0


def test_a_held_port_is_our_routers_alone() -> None:
    with held_endpoint() as endpoint:
        port = int(endpoint.rpartition(":")[2])
        for _ in range(2):  # the router, and the router started again
            with socket.create_server(("127.0.0.1", port)):
                pass
            with socket.socket() as stranger, pytest.raises(OSError, match="in use"):
                stranger.bind(("127.0.0.1", port))
    with held_endpoint(port) as again:
        assert again == endpoint


def test_a_taken_port_is_one_clear_line() -> None:
    with socket.create_server(("127.0.0.1", 0)) as other:
        port = other.getsockname()[1]
        with pytest.raises(InputError, match=f"port {port} on 127.0.0.1 is taken"), held_endpoint(port):
            pass
