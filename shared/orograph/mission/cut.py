"""One robot's tour cut into stretches, one for each robot, so that the longest drive is shortest: no stretch of street
lies between two shares.

Route first, cluster second (Beasley 1983); the cut itself is exact, over all assignments of robots to stretches.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from orograph.arrays import F64
from orograph.mission.cut_kernels import covered

ROBOTS_MAX = 10
"""More have too many subsets."""
WITHIN_M = 0.5


def cut(distance_m: F64, robots: int, tour: Sequence[int]) -> list[list[int]]:
    """Waypoints of a tour in driving order for each robot; `distance_m` as in `split_patrol`."""
    if not tour:
        return [[] for _ in range(robots)]
    stops = [robots + w for w in tour]
    from_m = np.ascontiguousarray(distance_m[np.ix_(range(robots), stops)])
    along_m = np.concatenate([[0.0], np.cumsum(distance_m[stops[:-1], stops[1:]])])
    low_m, high_m = 0.0, float(along_m[-1] + from_m.max())
    while high_m - low_m > WITHIN_M:
        middle_m = 0.5 * (low_m + high_m)
        done = covered(from_m, along_m, middle_m)[0][-1] == len(stops)
        low_m, high_m = (low_m, middle_m) if done else (middle_m, high_m)
    reach, last = covered(from_m, along_m, high_m)
    tours: list[list[int]] = [[] for _ in range(robots)]
    group = len(reach) - 1
    while group:
        robot = int(last[group])
        rest = group ^ (1 << robot)
        stretch = list(tour[reach[rest] : reach[group]])
        if stretch and from_m[robot, reach[group] - 1] < from_m[robot, reach[rest]]:
            stretch.reverse()
        tours[robot], group = stretch, rest
    return tours
