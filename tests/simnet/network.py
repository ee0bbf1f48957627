"""A seeded network that drops, doubles, delays and reorders, and can be cut per robot and direction."""

from __future__ import annotations

import heapq
from dataclasses import dataclass, field

import numpy as np


@dataclass
class Weather:
    """How bad the network is: chances per message, delays in frames beyond the first."""

    loss: float = 0.0
    double: float = 0.0
    late: float = 0.0
    late_frames_max: int = 0
    cut_up: set[str] = field(default_factory=set)
    cut_down: set[str] = field(default_factory=set)


class Network:
    """Messages between robots and the manager; what is sent in frame k arrives in frame k + 1 or later, or never."""

    def __init__(self, rng: np.random.Generator) -> None:
        self.weather = Weather()
        self._rng = rng
        self._up: list[tuple[int, int, str, object]] = []
        self._down: dict[str, list[tuple[int, int, object]]] = {}
        self._sent = 0

    def send_up(self, frame: int, robot: str, message: object) -> None:
        for due in self._arrivals(frame, robot in self.weather.cut_up):
            heapq.heappush(self._up, (due, self._sent, robot, message))

    def send_down(self, frame: int, robot: str, message: object) -> None:
        for due in self._arrivals(frame, robot in self.weather.cut_down):
            heapq.heappush(self._down.setdefault(robot, []), (due, self._sent, message))

    def _arrivals(self, frame: int, cut: bool) -> list[int]:
        self._sent += 1
        weather, draw = self.weather, self._rng.random(3)
        if cut or draw[0] < weather.loss:
            return []
        copies = 2 if draw[1] < weather.double else 1
        late = [self._rng.random() < weather.late for _ in range(copies)]
        return [frame + 1 + (int(self._rng.integers(1, weather.late_frames_max + 1)) if x else 0) for x in late]

    def arrived_up(self, frame: int) -> list[tuple[str, object]]:
        arrived = []
        while self._up and self._up[0][0] <= frame:
            _, _, robot, message = heapq.heappop(self._up)
            arrived.append((robot, message))
        return arrived

    def arrived_down(self, frame: int, robot: str) -> list[object]:
        queue, arrived = self._down.get(robot, []), []
        while queue and queue[0][0] <= frame:
            arrived.append(heapq.heappop(queue)[2])
        return arrived

    def late(self, frame: int) -> bool:
        """Whether something is still on its way that will arrive after the next frame."""
        dues = [item[0] for queue in (self._up, *self._down.values()) for item in queue]
        return any(due > frame + 1 for due in dues)
