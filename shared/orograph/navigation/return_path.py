"""The way back to the radio of a robot that has nothing left to do and hears nobody."""

from __future__ import annotations

import math

from orograph.messages import SECOND_NS
from orograph.scenario import PointM

SILENT_S = 5.0
"""The orchestrator speaks every second: so long without it is a shadow, not a lost message."""
FIRST_SILENT_S = 15.0
"""A robot that has never heard anything gives the orchestrator longer to appear."""
SPACING_M = 8.0
ARRIVED_M, LISTEN_S = 2.0, 3.0


class ReturnPath:
    """Places where the radio was heard, newest last; they are tried backwards, and the base station at the end."""

    def __init__(self, base_station_m: PointM) -> None:
        self._base_m = base_station_m
        self._places: list[PointM] = []
        self._heard_ns: int | None = None
        self._first_ns: int | None = None
        self._arrived_ns: int | None = None

    def heard(self, now_ns: int, x_m: float, y_m: float) -> None:
        """The orchestrator was heard here."""
        self._heard_ns, self._arrived_ns = now_ns, None
        if self._places and math.dist(self._places[-1], (x_m, y_m)) < SPACING_M:
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
        """Where to drive to hear something again; None while the radio is up."""
        if not self.silent(now_ns):
            return None
        place = self._places[-1] if self._places else self._base_m
        if math.dist(place, at_m) < ARRIVED_M:
            if self._arrived_ns is None:
                self._arrived_ns = now_ns
            if now_ns - self._arrived_ns > LISTEN_S * SECOND_NS:
                self.abandon()
            return None
        return place

    def abandon(self) -> None:
        """That place is no good: try the one before."""
        self._arrived_ns = None
        if self._places:
            self._places.pop()
