"""Moving bodies as the laser sees them: one box per robot and vehicle."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from orograph.geometry import rotation_from_quaternion
from orograph.messages import Packed
from orograph.scenario import Scenario
from orograph.scene import Mesh
from orograph.scene.mesh import joined

F64 = npt.NDArray[np.float64]

ROBOT_CLEARANCE_M = 0.1
"""A robot's box begins this far above the ground."""

_CORNERS = np.array([(x, y, z) for z in (0, 1) for y in (-0.5, 0.5) for x in (-0.5, 0.5)], np.float64)
_FACES = np.array(
    [[0, 2, 3], [0, 3, 1], [4, 5, 7], [4, 7, 6], [0, 1, 5], [0, 5, 4],
     [2, 6, 7], [2, 7, 3], [0, 4, 6], [0, 6, 2], [1, 3, 7], [1, 7, 5]], np.int32,
)  # fmt: skip


def box_mesh(size_m: tuple[float, float, float], clearance_m: float, R_map_body: F64, position_m: F64) -> Mesh:
    """A box (length, width, height) whose bottom face lies `clearance_m` above the body frame's origin."""
    corners = _CORNERS * size_m + (0.0, 0.0, clearance_m)
    return Mesh(corners @ R_map_body.T + position_m, _FACES)


def body_boxes(scenario: Scenario, poses: Packed, own: int, centre_m: F64, reach_m: float) -> Mesh:
    """Boxes of all present bodies that could lie within reach of a point, but for `poses[own]`, as one mesh.

    `poses` holds the robots by number, then the scenario's vehicles.
    """
    first_vehicle = len(poses) - len(scenario.vehicles)
    boxes = []
    for i in np.flatnonzero(poses["present"]):
        is_robot = i < first_vehicle
        size_m = scenario.robot.size_m if is_robot else scenario.vehicles[i - first_vehicle].size_m
        position_m = poses["position_m"][i]
        if i == own or np.linalg.norm(position_m - centre_m) > reach_m + sum(size_m) + ROBOT_CLEARANCE_M:
            continue
        R_map_body = rotation_from_quaternion(poses["quaternion_wxyz"][i])
        boxes.append(box_mesh(size_m, ROBOT_CLEARANCE_M if is_robot else 0.0, R_map_body, position_m))
    return joined(boxes)
