"""What orders cost in driven metres from where robots stand, and how they are best shared, lengthened and cut."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from itertools import pairwise

import numpy as np

from orograph.arrays import F64
from orograph.mission.distances import DrivingDistances
from orograph.mission.split import split_patrol
from orograph.scenario import PointM

Order = list[int]


class Legs:
    """The patrol's waypoints (by index) and the roads between them; places and orders are the caller's."""

    def __init__(self, waypoints_m: Sequence[PointM], roads: DrivingDistances) -> None:
        self._waypoints_m, self._roads, self.count = list(waypoints_m), roads, len(waypoints_m)
        self._between_m = roads.between(self._waypoints_m, self._waypoints_m)

    def _from_m(self, at_m: PointM) -> F64:
        from_m: F64 = self._roads.between([at_m], self._waypoints_m)[0]
        return from_m

    def _along_m(self, order: Sequence[int]) -> float:
        return float(sum(self._between_m[a, b] for a, b in pairwise(order)))

    def length_m(self, at_m: PointM, order: Sequence[int]) -> float:
        """F64 to drive from a place through all of an order."""
        return float(self._from_m(at_m)[order[0]]) + self._along_m(order) if order else 0.0

    def detour(self, at_m: PointM, order: Sequence[int], waypoint: int) -> tuple[float, Order]:
        """F64 that one waypoint more costs at the best place of an order, and the order with it."""
        from_m = self._from_m(at_m)
        longer = [[*order[:k], waypoint, *order[k:]] for k in range(len(order) + 1)]
        lengths_m = [float(from_m[tour[0]]) + self._along_m(tour) for tour in longer]
        best = int(np.argmin(lengths_m))
        return lengths_m[best] - (float(from_m[order[0]]) + self._along_m(order) if order else 0.0), longer[best]

    def split(
        self, places_m: Sequence[PointM], refused: Sequence[Collection[int]], waypoints: Sequence[int]
    ) -> list[Order]:
        """An order for each place so that the longest is shortest; `refused` names what each place must not get."""
        robots, size = len(places_m), len(places_m) + len(waypoints)
        distance_m = np.zeros((size, size))
        distance_m[:robots, robots:] = [self._from_m(place)[list(waypoints)] for place in places_m]
        distance_m[robots:, :robots] = distance_m[:robots, robots:].T
        distance_m[robots:, robots:] = self._between_m[np.ix_(waypoints, waypoints)]
        barred = [{i for i, w in enumerate(waypoints) if w in taboo} for taboo in refused]
        return [[waypoints[i] for i in tour] for tour in split_patrol(robots, distance_m, barred)]

    def share_end(
        self, donor_m: PointM, order: Sequence[int], taker_m: PointM, refused: Collection[int]
    ) -> tuple[float, Order, Order]:
        """The longer of two tours [m], what the donor keeps and what the taker drives, from whichever end is nearer."""
        donor_from_m, taker_from_m = self._from_m(donor_m), self._from_m(taker_m)
        shares: list[tuple[float, Order, Order]] = []
        for k in range(1, len(order)):
            kept, end = list(order[:k]), list(order[k:])
            if refused and not set(refused).isdisjoint(end):
                continue
            for taken in (end, end[::-1]):
                tours_m = (
                    float(donor_from_m[kept[0]]) + self._along_m(kept),
                    float(taker_from_m[taken[0]]) + self._along_m(taken),
                )
                shares.append((max(tours_m), kept, taken))
        return min(shares, default=(np.inf, list(order), []))
