"""The witness's lines as they come: the runner's clock, and the history's backbone."""

from __future__ import annotations

import json
import subprocess
import threading
from collections.abc import Callable
from types import TracebackType
from typing import Any

from chaos.cluster import Cluster, until

LOOK_S = 0.05
Line = dict[str, Any]
Figures = dict[str, dict[str, float]]


class Watch:
    """Follows the witness's output in a thread of its own; `lines` and `figures` are what there was so far."""

    def __init__(self, cluster: Cluster) -> None:
        self._follower = subprocess.Popen(
            ["docker", "logs", "--follow", cluster.only("witness")],
            stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True,
        )  # fmt: skip
        self.lines: list[Line] = []
        self.figures: Figures = {}
        self._thread = threading.Thread(target=self._follow, daemon=True)
        self._thread.start()

    def __enter__(self) -> Watch:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, _: TracebackType | None) -> None:
        self._follower.terminate()
        self._follower.wait()
        self._thread.join(10)
        if self._follower.stdout is not None:
            self._follower.stdout.close()

    def _follow(self) -> None:
        assert self._follower.stdout is not None
        for text in self._follower.stdout:
            if text.startswith("{") and text.endswith("\n"):
                line = json.loads(text)
                self.lines.append(line)
                if line["kind"] == "figures":
                    self.figures[line["node"]] = line["figures"]

    @property
    def frame(self) -> int:
        """The world's newest frame that was told."""
        return int(self.figures.get("world", {}).get("frame", -1))

    def of(self, node: str, figure: str) -> float:
        """A figure's newest value, -1 where none was told."""
        return self.figures.get(node, {}).get(figure, -1.0)

    def await_frame(self, frame: int, within_s: float = 120.0) -> None:
        """Until the world has come so far."""
        until(lambda: self.frame >= frame, f"frame {frame}", within_s, LOOK_S)

    def await_figure(self, node: str, figure: str, holds: Callable[[float], bool], within_s: float = 60.0) -> None:
        """Until a figure is as wanted."""
        until(lambda: holds(self.of(node, figure)), f"{figure} of {node}", within_s, LOOK_S)
