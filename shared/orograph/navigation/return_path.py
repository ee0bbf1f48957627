"""The way back to the radio of a robot that has nothing left to do and hears nobody."""

from __future__ import annotations

import math

from orograph.messages import SECOND_NS
from orograph.scenario import PointM

SILENT_S = 5.0
"""The orchestrator speaks every second: so long without it is a shadow, not a lost message."""
FIRST_SILENT_S = 15.0
"""A robot that has never heard anything gives the orchestrator longer to appear."""
SPACING_M, ARRIVED_M = 8.0, 2.0


class ReturnPath:
    """Places where the radio was heard, newest last: driven to backwards until it is, at last the base station."""

    def __init__(self, base_station_m: PointM) -> None:
        self._base_m = base_station_m
        self._places: list[PointM] = []
        self._heard_ns: int | None = None
        self._first_ns: int | None = None

    def heard(self, now_ns: int, x_m: float, y_m: float) -> None:
        """The orchestrator was heard here."""
        self._heard_ns = now_ns
        if len(self._places) > 1 and math.dist(self._places[-2], (x_m, y_m)) < SPACING_M:
            self._places.pop()
        self._places.append((x_m, y_m))

    def silent(self, now_ns: int) -> bool:
        """Whether nothing has been heard for so long that the robot must be out of reach."""
        if self._first_ns is None:
            self._first_ns = now_ns
        if self._heard_ns is None:
            return now_ns - self._first_ns > FIRST_SILENT_S * SECOND_NS
        return now_ns - self._heard_ns > SILENT_S * SECOND_NS

    def goal(self, now_ns: int, at_m: PointM) -> PointM | None:
        """Where to drive to hear something again; None while the radio is up, and at the base station.

        A place is not waited at: who came near it from within a shadow may still be inside.
        """
        if not self.silent(now_ns):
            return None
        while self._places and math.dist(self._places[-1], at_m) < ARRIVED_M:
            self._places.pop()
        if self._places:
            return self._places[-1]
        return None if math.dist(self._base_m, at_m) < ARRIVED_M else self._base_m

    def abandon(self) -> None:
        """That place cannot be reached: try the one before."""
        if self._places:
            self._places.pop()
