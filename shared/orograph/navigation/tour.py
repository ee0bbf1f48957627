"""Which waypoints a robot still has to visit, has visited, and has given up."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from orograph.messages import Mission, Packed
from orograph.scenario import PointM

VISIT_M = 4.0


class Tour:
    """The newest mission and what has become of its waypoints; visited and given up are kept for the robot's life."""

    def __init__(self, patrol: Sequence[PointM]) -> None:
        self._patrol = patrol
        self._order: list[int] = []
        self.number = 0
        self.flush = False
        self.visited: list[int] = []
        self.given_up: list[int] = []

    def take(self, mission: Mission) -> bool:
        """Adopt a newer mission; False for one already known or older. Unknown indices are left out."""
        if mission.number == self.number:
            self.flush |= mission.flush
        if mission.number <= self.number:
            return False
        self.number, self.flush = mission.number, mission.flush
        self._order = [int(i) for i in mission.waypoints if i < len(self._patrol)]
        return True

    @property
    def left(self) -> list[int]:
        """Waypoints still to visit, in order."""
        return [] if self.flush else [i for i in self._order if i not in self.visited and i not in self.given_up]

    @property
    def unreached(self) -> bool:
        """A waypoint of the present mission was given up."""
        return any(i in self.given_up for i in self._order)

    def goals(self) -> tuple[PointM, ...]:
        """Positions of the next waypoint and the one after it, as far as there are any."""
        return tuple(self._patrol[i] for i in self.left[:2])

    def visit(self, x_m: float, y_m: float) -> list[int]:
        """Mark the mission's waypoints within VISIT_M of the robot; returns those newly visited."""
        new = [i for i in self.left if math.dist(self._patrol[i], (x_m, y_m)) <= VISIT_M]
        self.visited += new
        return new

    def give_up(self) -> int:
        """Hand over the next waypoint; returns its index."""
        index = self.left[0]
        self.given_up.append(index)
        return index

    def status_arrays(self) -> tuple[Packed, Packed]:
        """(visited, given up) as sent in RobotStatus."""
        return np.array(self.visited, "<u2"), np.array(self.given_up, "<u2")
