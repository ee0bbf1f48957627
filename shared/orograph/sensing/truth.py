"""What a perfect sensor would see of the static scene: the true top surface of cells, and noise-free dense scans."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import numpy.typing as npt

from orograph.arrays import F32, F64, Mask
from orograph.geometry import laser_position_m
from orograph.grid import Grid
from orograph.layers import Layer
from orograph.points import points_from_ranges
from orograph.scene import Scene
from orograph.scene.bodies import standing_robot
from orograph.scene.mesh import joined
from orograph.scene.prior import COVERED
from orograph.scene.terrain import ground_gradient
from orograph.sensing.bodies import NO_BOXES
from orograph.sensing.embree import LANES, Device, Solid
from orograph.sensing.laser import RangeImager


def _heights_from_above(scene: Scene, grid: Grid) -> tuple[F64, Mask]:
    """Top surface [m] under each cell's centre and whether a building makes it, both (rows, cols)."""
    ground, buildings = scene.meshes_in(grid.extent_m)
    mesh = joined([ground, buildings])
    above_m, below_m = mesh.vertices[:, 2].max() + 1.0, mesh.vertices[:, 2].min() - 1.0
    x, y = grid.centres_m()
    solid = Solid(Device(), mesh, np.array([x[0], y[0], above_m]))
    width = len(x) + -len(x) % LANES
    origins, down = np.zeros((3, width)), np.repeat(np.array([[0], [0], [-1]], np.float32), width, axis=1)
    origins[0, : len(x)] = x - x[0]
    depth, face = np.empty((len(y), width)), np.empty((len(y), width), np.int32)
    for row, y_m in enumerate(y):
        origins[1] = y_m - y[0]
        solid.meet(origins, down, above_m - below_m, face[row], depth[row])
    depth, face = depth[:, : len(x)], face[:, : len(x)]
    return np.where(face < 0, np.nan, above_m - depth), face >= len(ground.faces)


def _block_mean(values: F64, factor: int) -> F64:
    rows, cols = values.shape
    return np.asarray(values.reshape(rows // factor, factor, cols // factor, factor).mean(axis=(1, 3)), np.float64)


def top_surface(scene: Scene, grid: Grid, samples_per_cell: int = 4) -> tuple[Layer, Mask]:
    """(height, occupied): mean true top surface [m], float32, and whether a cell can't be driven, both (rows, cols).

    Vertical rays at `samples_per_cell` x `samples_per_cell` places per cell. Occupied: at least 40 % of the places are
    building (as in the prior), or the ground's slope at the centre exceeds the robot's slope_max. Height is NaN
    beyond the ground's margin.
    """
    height, building = _heights_from_above(scene, grid.refined(samples_per_cell))
    holds_building = _block_mean(building.astype(np.float64), samples_per_cell) >= COVERED
    x, y = np.meshgrid(*grid.centres_m())
    slope = np.hypot(*ground_gradient(scene.scenario.terrain, x, y))
    occupied = holds_building | (slope > scene.scenario.robot.slope_max)
    return _block_mean(height, samples_per_cell).astype(np.float32), occupied


def dense_scans(scene: Scene, poses: npt.ArrayLike, density: int = 2) -> Iterator[tuple[F64, F32, F64]]:
    """Per pose (x, y, yaw) of `poses` (n, 3): collision points (k, 3), their ranges (k,), the position (3,) [m].

    Points and position (the robot's origin on the ground) are in the map frame. Noise, dropouts and moving bodies are
    none; rings and columns are `density` times the scenario's.
    """
    spec = scene.scenario.laser
    size = {"rings": spec.rings * density, "columns": spec.columns * density}
    laser = spec.model_copy(update={**size, "noise_m": 0.0, "dropout": 0.0})
    camera = RangeImager(scene, laser)
    for x_m, y_m, yaw_rad in np.asarray(poses, np.float64).reshape(-1, 3):
        R_map_robot, position_m = standing_robot(scene, x_m, y_m, yaw_rad)
        ranges = camera.image(R_map_robot, position_m, NO_BOXES, np.uint64(0))
        eye_m = laser_position_m(laser, R_map_robot, position_m)
        yield *points_from_ranges(ranges, camera.directions, R_map_robot, eye_m), position_m
