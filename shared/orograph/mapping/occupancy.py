"""What planning is told of the HRM: own evidence over the prior, and elsewhere what the robot was told."""

from __future__ import annotations

from collections import deque

import numpy as np
import numpy.typing as npt

from orograph.layers import UNKNOWN_OCCUPATION
from orograph.mapping.cells import Cells, Values
from orograph.mapping.evidence import Evidence
from orograph.mapping.occupancy_kernels import bar_cells, planning_codes
from orograph.mapping.rolling import roll_into
from orograph.rules import RealRules

SHOWN_MS = 1_000
"""So long planning sees what a scan showed to stand."""
Codes = npt.NDArray[np.uint8]
"""Occupation in 1/254, 255 unknown."""


class OccupancyView:
    """Occupation codes over the evidence's window, which roll with it; only what changed is computed."""

    def __init__(self, evidence: Evidence, rules: RealRules) -> None:
        self._evidence, self._rules = evidence, rules
        side, blocks = evidence.blocks * evidence.factor, evidence.blocks
        self._codes: Codes = np.full((side, side), UNKNOWN_OCCUPATION, np.uint8)
        self._told: Codes = np.full((blocks, blocks), UNKNOWN_OCCUPATION, np.uint8)
        self._window: tuple[int, int] | None = None
        self._prior: Values | None = None
        self._shown: deque[tuple[int, tuple[int, int], Cells]] = deque()

    def show(self, tick: int, cells: Cells) -> None:
        """A scan of `tick` [ms] shows that something stands in these fine cells: planning knows at once."""
        assert self._evidence.window is not None, "no scan yet"
        self._shown.append((tick, self._evidence.window, cells))
        while self._shown[0][0] <= tick - SHOWN_MS:
            self._shown.popleft()

    def codes(self, prior: Values, told: Codes) -> Codes:
        """Codes (rows, cols) of evidence over `prior` (cells, WIDTH), of `told` (cells,) where there is no evidence."""
        evidence = self._evidence
        assert evidence.window is not None, "no scan yet"
        self._roll_to(evidence.window)
        if prior is not self._prior:
            self._prior, evidence.stale[:] = prior, True
        planning_codes(
            evidence.values, prior, told, evidence.glrm.shape, evidence.window, evidence.factor, self._rules,
            evidence.stale.reshape(-1), self._told.reshape(-1), self._codes,
        )  # fmt: skip
        return self._with_shown(self._codes.copy())

    def _with_shown(self, codes: Codes) -> Codes:
        """The instant layer: the last scans' obstacles, whatever the slow map holds there."""
        assert self._window is not None
        for _, (row, col), cells in self._shown:
            moved = self._evidence.factor * (row - self._window[0]), self._evidence.factor * (col - self._window[1])
            bar_cells(codes, cells, *moved)
        return codes

    def _roll_to(self, window: tuple[int, int]) -> None:
        """What enters is stale in the evidence's eyes, so its old codes here do no harm."""
        if self._window is not None and self._window != window:
            rows, cols = window[0] - self._window[0], window[1] - self._window[1]
            factor, codes, told = self._evidence.factor, self._codes.copy(), self._told.copy()
            roll_into(self._codes, codes, (rows * factor, cols * factor))
            roll_into(self._told, told, (rows, cols))
        self._window = window
