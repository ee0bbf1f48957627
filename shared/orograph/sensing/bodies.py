"""Moving bodies as the laser sees them: one box per robot and vehicle."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit

from orograph.arrays import F64, U1
from orograph.messages import Packed
from orograph.scenario import Scenario
from orograph.scene.bodies import robot_box, vehicle_box


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
        self._robot_m = np.array(robot_box(scenario.robot))
        self._robots, self._sizes_m = -1, np.zeros((0, 4))
        self._vehicles_m = np.array([vehicle_box(vehicle) for vehicle in scenario.vehicles]).reshape(-1, 4)

    def boxes(self, poses: Packed, own: int, reach_m: float) -> Boxes:
        """Boxes of all present bodies that could lie within reach of body `own`, without that body.

        `poses` (n,) POSE holds the robots by number, then the scenario's vehicles.
        """
        robots = len(poses) - len(self._vehicles_m)
        if robots != self._robots:
            self._robots, self._sizes_m = robots, np.vstack([np.tile(self._robot_m, (robots, 1)), self._vehicles_m])
        return Boxes(
            *_boxes_near(poses["position_m"], poses["quaternion_wxyz"], poses["present"], self._sizes_m, own, reach_m)
        )


@njit(cache=True)
def _boxes_near(
    positions_m: F64, quaternions: F64, present: U1, sizes_m: F64, own: int, reach_m: float
) -> tuple[F64, F64, F64]:
    """Centres (k, 3), half sizes (k, 3), R_box_map (k, 3, 3) of boxes that stand on their clearance, sizes (n, 4)."""
    count = 0
    centres_m, half_m, R_box_map = (
        np.empty(positions_m.shape),
        np.empty(positions_m.shape),
        np.empty((len(present), 3, 3)),
    )
    for i in range(positions_m.shape[0]):
        away_m2 = 0.0
        for axis in range(3):
            away_m2 += (positions_m[i, axis] - positions_m[own, axis]) ** 2
        length, width, height, clearance = sizes_m[i, 0], sizes_m[i, 1], sizes_m[i, 2], sizes_m[i, 3]
        if i == own or not present[i] or away_m2 > (reach_m + length + width + height + clearance) ** 2:
            continue
        w, x, y, z = quaternions[i, 0], quaternions[i, 1], quaternions[i, 2], quaternions[i, 3]
        R = R_box_map[count]
        R[0, 0], R[0, 1], R[0, 2] = 1 - 2 * (y * y + z * z), 2 * (x * y + w * z), 2 * (x * z - w * y)
        R[1, 0], R[1, 1], R[1, 2] = 2 * (x * y - w * z), 1 - 2 * (x * x + z * z), 2 * (y * z + w * x)
        R[2, 0], R[2, 1], R[2, 2] = 2 * (x * z + w * y), 2 * (y * z - w * x), 1 - 2 * (x * x + y * y)
        half_m[count, 0], half_m[count, 1], half_m[count, 2] = length / 2, width / 2, height / 2
        for axis in range(3):
            centres_m[count, axis] = positions_m[i, axis] + R[2, axis] * (clearance + height / 2)
        count += 1
    return centres_m[:count], half_m[:count], R_box_map[:count]
