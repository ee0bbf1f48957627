"""Moving bodies as the laser sees them: one box per robot and vehicle."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from orograph.arrays import F64
from orograph.geometry import rotation_from_quaternion
from orograph.messages import Packed
from orograph.scenario import Scenario

ROBOT_CLEARANCE_M = 0.1
"""A robot's box reaches from this far above the ground to the robot's height."""


@dataclass(frozen=True, eq=False)
class Boxes:
    """Boxes in the map frame: centres (k, 3) [m], half sizes (k, 3) [m], R_box_map (k, 3, 3)."""

    centres_m: F64
    half_m: F64
    R_box_map: F64


NO_BOXES = Boxes(np.zeros((0, 3)), np.zeros((0, 3)), np.zeros((0, 3, 3)))


class Bodies:
    """The boxes of a scenario's robots and vehicles wherever they are."""

    def __init__(self, scenario: Scenario) -> None:
        length, width, height = scenario.robot.size_m
        clearance = min(ROBOT_CLEARANCE_M, 0.5 * height)
        self._robot_m = np.array([length, width, height - clearance, clearance])
        self._robots, self._sizes_m = -1, np.zeros((0, 4))
        self._vehicles_m = np.array([(*vehicle.size_m, 0.0) for vehicle in scenario.vehicles]).reshape(-1, 4)

    def boxes(self, poses: Packed, own: int, reach_m: float) -> Boxes:
        """Boxes of all present bodies that could lie within reach of body `own`, without that body.

        `poses` (n,) POSE holds the robots by number, then the scenario's vehicles.
        """
        robots = len(poses) - len(self._vehicles_m)
        if robots != self._robots:
            self._robots, self._sizes_m = robots, np.vstack([np.tile(self._robot_m, (robots, 1)), self._vehicles_m])
        sizes_m, positions_m = self._sizes_m, poses["position_m"]
        near = ((positions_m - positions_m[own]) ** 2).sum(axis=1) <= (reach_m + sizes_m.sum(axis=1)) ** 2
        near &= poses["present"] > 0
        near[own] = False
        seen = np.flatnonzero(near)
        if not len(seen):
            return NO_BOXES
        R_map_body = np.stack([rotation_from_quaternion(q) for q in poses["quaternion_wxyz"][seen]])
        half_m, clearance_m = sizes_m[seen, :3] / 2, sizes_m[seen, 3]
        centres_m = positions_m[seen] + R_map_body[:, :, 2] * (clearance_m + half_m[:, 2])[:, None]
        return Boxes(centres_m, half_m, np.ascontiguousarray(R_map_body.transpose(0, 2, 1)))
