"""A robot's mapping in miniature: own evidence per cell in integers, no float, no laser; it never forgets by ageing."""

from __future__ import annotations

import numpy as np
from orograph.messages import UPDATE
from orograph.protocol.fold import same_values


class Mapper:
    """Cumulative evidence (cells,) of UPDATE and what the manager is known to hold."""

    def __init__(self, size: int) -> None:
        self.evidence = np.zeros(size, UPDATE)
        self.evidence["cell"] = np.arange(size)
        self._baseline = self.evidence.copy()

    def scan(self, cells: np.ndarray, heights_mm: np.ndarray, tick_ms: int) -> np.ndarray:
        """Add one look at each of these cells; the records that are worth sending."""
        own, old = self.evidence, self.evidence[cells]
        seen = old["confidence"].astype(np.int64)
        own["height"][cells] = (old["height"] * seen + heights_mm * 10) // (seen + 10)
        own["gradient_x"][cells] = heights_mm % 700
        own["gradient_y"][cells] = -(heights_mm % 300)
        own["occupation"][cells] = heights_mm % 255
        own["confidence"][cells] = np.minimum(255, seen + 10)
        own["tick"][cells] = tick_ms
        return own[cells]

    def acknowledge(self, records: np.ndarray) -> None:
        self._baseline[records["cell"]] = records

    def adopt(self, row: np.ndarray, first_life: bool) -> None:
        """Take the robot's own row: where nothing is known here, or fused with it when it is of an earlier life."""
        for held in row:
            cell = int(held["cell"])
            for name in UPDATE.names:
                self._baseline[name][cell] = held[name]
            mine = self.evidence[cell]
            if mine["confidence"] == 0:
                self.evidence[cell] = self._baseline[cell]
            elif first_life:
                self.evidence["confidence"][cell] = min(255, int(mine["confidence"]) + int(held["confidence"]))

    def unacknowledged(self) -> np.ndarray:
        differs = ~same_values(self.evidence, self._baseline, "tick") & (self.evidence["confidence"] > 0)
        return self.evidence[differs]
