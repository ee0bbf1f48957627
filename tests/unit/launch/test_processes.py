"""What a run of processes shows to those who watch it."""

import itertools
import threading
from pathlib import Path

import pytest
from orograph.launch import processes
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
    processes._follow(Turns(50), "", tmp_path, lambda figures, _: seen.append(sum(1 for _ in figures)))
    assert len(seen) == 50 and seen[-1] > 0
