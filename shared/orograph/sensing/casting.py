"""Rays against the scene, by Embree, and against moving boxes.

Embree computes in float32, so it is given a window of the scene around the ray's origin, in coordinates of the
window: that keeps the error below 0.1 mm at any place of a map, and the search tree small. Windows lie on fixed
tiles, so what a ray meets depends on where it starts, never on where the robot has been.
"""

from __future__ import annotations

from collections import OrderedDict
from dataclasses import dataclass

import numpy as np
from embreex.mesh_construction import TriangleMesh
from embreex.rtcore import EmbreeDevice
from embreex.rtcore_scene import EmbreeScene

from orograph.arrays import F32, F64, I32
from orograph.scene import Mesh, Scene
from orograph.scene.mesh import joined
from orograph.sensing.bodies import Boxes
from orograph.sensing.ray_kernels import drop_beyond, nearest_box_hits, split_by_slope

TILE_M = 50.0
WINDOWS_KEPT = 4
"""A robot at a corner where four tiles meet builds none of them twice."""


def embree_scene(device: EmbreeDevice, mesh: Mesh, origin_m: F64) -> EmbreeScene | None:
    """The mesh, relative to `origin_m`, ready for rays; None for an empty mesh."""
    if not len(mesh.faces):
        return None
    # Robust costs 15 %, but without it one in ten rays aimed at an edge that two faces share slips through.
    scene = EmbreeScene(device, robust=True)
    TriangleMesh(scene, (mesh.vertices - origin_m).astype(np.float32), mesh.faces)
    return scene


def nearest_hits(scene: EmbreeScene | None, origins: F32, rays: F32, distances: F32) -> None:
    """Shorten `distances` (n,) in place to the nearest hits of rays (n, 3) from origins (n, 3)."""
    if scene is not None and len(distances):
        scene.run(origins, rays, dists=distances, query="DISTANCE")


def steepest_slope(mesh: Mesh) -> float:
    """Greatest slope [m/m] of a ground mesh's faces, all seen from above."""
    a, b, c = (mesh.vertices[mesh.faces[:, i]] for i in range(3))
    normals = np.cross(b - a, c - a)
    return float((np.hypot(normals[:, 0], normals[:, 1]) / normals[:, 2]).max())


@dataclass(frozen=True, eq=False)
class Window:
    """All that is solid within reach of one tile, relative to `origin_m`."""

    origin_m: F64
    solid: EmbreeScene
    buildings: EmbreeScene | None
    steepest: float


class RayCaster:
    """Nearest hits on a scene's ground and buildings, and on moving boxes given with each call."""

    def __init__(self, scene: Scene, reach_m: float) -> None:
        self._scene, self._reach_m = scene, reach_m
        self._device = EmbreeDevice()
        self._windows: OrderedDict[tuple[int, int], Window] = OrderedDict()
        self._rays: F32 = np.empty((0, 3), np.float32)
        self._origins: F32 = np.empty((0, 3), np.float32)

    def distances(self, origin_m: F64, R_map_laser: F64, directions: F32, boxes: Boxes) -> tuple[F32, I32]:
        """Distances (n,) [m] to the nearest hits, inf where none in reach, and the ray (n,) that each belongs to.

        Unit directions (n, 3) are in the laser frame. A ray that rises more steeply than any ground in the window can
        only meet buildings and boxes, so the ground is not searched for it: the origin must be above the ground.
        """
        window = self._window(origin_m)
        if len(self._rays) != len(directions):
            self._rays, self._origins = np.empty_like(directions), np.empty_like(directions)
        rays, origins, places = self._rays, self._origins, np.empty(len(directions), np.int32)
        first = split_by_slope(
            directions, R_map_laser, window.steepest, origin_m - window.origin_m, rays, origins, places
        )
        nearest = np.full(len(rays), self._reach_m, np.float32)
        nearest_hits(window.solid, origins[:first], rays[:first], nearest[:first])
        nearest_hits(window.buildings, origins[first:], rays[first:], nearest[first:])
        nearest_box_hits(rays, nearest, boxes.centres_m - origin_m, boxes.half_m, boxes.R_box_map)
        drop_beyond(nearest, self._reach_m)  # else noise could pull an empty ray into range
        return nearest, places

    def _window(self, origin_m: F64) -> Window:
        tile = int(origin_m[0] // TILE_M), int(origin_m[1] // TILE_M)
        if tile not in self._windows:
            self._windows[tile] = self._build(tile)
            if len(self._windows) > WINDOWS_KEPT:
                self._windows.popitem(last=False)
        self._windows.move_to_end(tile)
        return self._windows[tile]

    def _build(self, tile: tuple[int, int]) -> Window:
        x, y = (tile[0] + 0.5) * TILE_M, (tile[1] + 0.5) * TILE_M
        half_m = TILE_M / 2 + self._reach_m
        ground, buildings = self._scene.meshes_in((x - half_m, y - half_m, x + half_m, y + half_m))
        origin_m = np.array([x, y, float(self._scene.height_m(x, y))])
        solid = embree_scene(self._device, joined([ground, buildings]), origin_m)
        assert solid is not None, "a window always holds ground"
        # A little more than the steepest: a ray along that very slope must search the ground, whatever float32 does.
        steepest = steepest_slope(ground) * 1.001 + 1e-3
        return Window(origin_m, solid, embree_scene(self._device, buildings, origin_m), steepest)
