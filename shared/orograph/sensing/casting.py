"""Rays against the scene, by Embree, and against moving boxes.

Embree computes in float32, so it is given a window of the scene around the ray's origin, in coordinates of the
window: that keeps what it takes for an edge within 0.01 mm of it at any place of a map, and the search tree small.
Windows lie on fixed tiles, so what a ray meets depends on where it starts, never on where the robot has been.
"""

from __future__ import annotations

from collections import OrderedDict
from dataclasses import dataclass

import numpy as np

from orograph.arrays import F32, F64
from orograph.scene import Scene
from orograph.scene.mesh import joined
from orograph.sensing.bodies import Boxes
from orograph.sensing.embree import LANES, Device, Solid
from orograph.sensing.ray_kernels import meet_boxes, turn

TILE_M = 50.0
WINDOWS_PER_ROBOT = 4
"""Kept, so that a robot at a corner where four tiles meet builds none of them twice."""


@dataclass(frozen=True, eq=False)
class Window:
    """All that is solid within reach of one tile, relative to `origin_m`."""

    origin_m: F64
    solid: Solid


class RayCaster:
    """Nearest hits on a scene's ground and buildings, and on moving boxes given with each call, for some robots."""

    def __init__(self, scene: Scene, reach_m: float, robots: int = 1, isa: str = "avx2") -> None:
        self._scene, self._reach_m, self._kept = scene, reach_m, WINDOWS_PER_ROBOT * robots
        self._device = Device(isa)
        self._windows: OrderedDict[tuple[int, int], Window] = OrderedDict()
        self._make_room(0)

    def distances(self, origin_m: F64, R_map_laser: F64, directions: F32, boxes: Boxes) -> F64:
        """Distances (n,) [m] to the nearest hits of rays from one origin, inf where there is none below the reach.

        Unit directions (3, n) are in the laser frame; it is faster where each lies beside the one before. The result
        is good until the next call.
        """
        window, count = self._window(origin_m), directions.shape[1]
        if len(self._faces) != count + -count % LANES:
            self._make_room(count + -count % LANES)
        turn(directions, R_map_laser, self._rays)
        eye_m = (origin_m - window.origin_m)[:, None]
        window.solid.meet(eye_m, self._rays, self._reach_m, self._faces, self._away_m)
        from_eye_m = boxes.centres_m - origin_m
        meet_boxes(self._rays, from_eye_m, boxes.half_m, boxes.R_box_map, self._reach_m, self._away_m)
        return self._away_m[:count]

    def _make_room(self, count: int) -> None:
        # Kept: 600 kB that come anew from the system with every scan would cost a tenth of it.
        self._rays, self._faces = np.ones((3, count), np.float32), np.empty(count, np.int32)
        self._away_m = np.empty(count)

    def _window(self, origin_m: F64) -> Window:
        tile = int(origin_m[0] // TILE_M), int(origin_m[1] // TILE_M)
        if tile not in self._windows:
            self._windows[tile] = self._build(tile)
            if len(self._windows) > self._kept:
                self._windows.popitem(last=False)
        self._windows.move_to_end(tile)
        return self._windows[tile]

    def _build(self, tile: tuple[int, int]) -> Window:
        x, y = (tile[0] + 0.5) * TILE_M, (tile[1] + 0.5) * TILE_M
        half_m = TILE_M / 2 + self._reach_m
        mesh = joined(self._scene.meshes_in((x - half_m, y - half_m, x + half_m, y + half_m)))
        origin_m = np.array([x, y, float(self._scene.height_m(x, y))])
        return Window(origin_m, Solid(self._device, mesh, origin_m))
