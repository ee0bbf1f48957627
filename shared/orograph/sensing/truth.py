"""What a perfect sensor would see of the static scene: the true top surface of cells, and noise-free dense scans."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import numpy.typing as npt
from embreex.rtcore import EmbreeDevice

from orograph.arrays import F32, F64, Mask
from orograph.grid import Grid
from orograph.layers import Layer
from orograph.points import points_from_ranges
from orograph.scene import Scene
from orograph.scene.mesh import joined
from orograph.scene.prior import COVERED
from orograph.scene.terrain import ground_gradient
from orograph.sensing.bodies import NO_BOXES
from orograph.sensing.casting import embree_scene, nearest_hits
from orograph.sensing.laser import RangeImager, laser_position_m


def _heights_from_above(scene: Scene, grid: Grid) -> tuple[F64, Mask]:
    """Top surface [m] under each cell's centre and whether a building makes it, both (rows, cols)."""
    ground, buildings = scene.meshes_in(grid.extent_m)
    x0, y0, x1, y1 = grid.extent_m
    above_m = joined([ground, buildings]).vertices[:, 2].max() + 1.0
    centre_m = np.array([(x0 + x1) / 2, (y0 + y1) / 2, above_m])
    x, y = np.meshgrid(*grid.centres_m())
    origins = (np.stack([x, y, np.full_like(x, above_m)], axis=-1).reshape(-1, 3) - centre_m).astype(np.float32)
    down = np.tile(np.array([0, 0, -1], np.float32), (grid.size, 1))
    depth = np.full(grid.size, np.inf, np.float32)
    nearest_hits(embree_scene(EmbreeDevice(), ground, centre_m), origins, down, depth)
    to_ground = depth.copy()
    nearest_hits(embree_scene(EmbreeDevice(), buildings, centre_m), origins, down, depth)
    height = np.where(np.isinf(depth), np.nan, above_m - depth.astype(np.float64))
    return height.reshape(grid.shape), (depth < to_ground).reshape(grid.shape)


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


def standing(scene: Scene, x_m: float, y_m: float, yaw_rad: float) -> tuple[F64, F64]:
    """(R_map_robot (3, 3), position (3,)) of a robot that stands still on the ground, upright to its slope."""
    gradient_x, gradient_y = (float(g) for g in ground_gradient(scene.scenario.terrain, x_m, y_m))
    up = np.array([-gradient_x, -gradient_y, 1.0]) / np.sqrt(1 + gradient_x**2 + gradient_y**2)
    c, s = np.cos(yaw_rad), np.sin(yaw_rad)
    ahead = np.array([c, s, gradient_x * c + gradient_y * s])
    ahead /= np.linalg.norm(ahead)
    R_map_robot = np.stack([ahead, np.cross(up, ahead), up], axis=1)
    return R_map_robot, np.array([x_m, y_m, float(scene.height_m(x_m, y_m))])


def dense_scans(scene: Scene, poses: npt.ArrayLike, density: int = 2) -> Iterator[tuple[F64, F32, F64]]:
    """Per pose (x, y, yaw) of `poses` (n, 3): collision points (k, 3), their ranges (k,), the position (3,) [m].

    Points and position (the robot's origin on the ground) are in the map frame. Noise, dropouts and moving bodies are
    none; rings and columns are `density` times the scenario's.
    """
    spec = scene.scenario.laser
    size = {"rings": spec.rings * density, "columns": spec.columns * density}
    laser = spec.model_copy(update={**size, "noise_m": 0.0, "dropout": 0.0})
    camera = RangeImager(scene, laser)
    no_draws = np.zeros((2, laser.rings * laser.columns), np.uint16)
    for x_m, y_m, yaw_rad in np.asarray(poses, np.float64).reshape(-1, 3):
        R_map_robot, position_m = standing(scene, x_m, y_m, yaw_rad)
        ranges = camera.image(R_map_robot, position_m, NO_BOXES, no_draws)
        eye_m = laser_position_m(laser, R_map_robot, position_m)
        yield *points_from_ranges(ranges, camera.directions, R_map_robot, eye_m), position_m
