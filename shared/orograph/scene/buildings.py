"""Buildings as closed meshes: footprints raised to flat, gable or hip roofs."""

from __future__ import annotations

import math

import mapbox_earcut
import numpy as np
import shapely

from orograph.arrays import F64, I32
from orograph.scenario import Building, TerrainSpec
from orograph.scene.mesh import Mesh
from orograph.scene.terrain import ground_height_m

SUNK_M = 2.0
"""Walls begin this far below the lowest ground at the footprint, so that no gap shows."""
RECTANGLE_TOLERANCE_M = 0.1


def footprint_polygon(building: Building) -> shapely.Polygon:
    """The footprint, counter-clockwise; raises ValueError where it crosses itself or has no area."""
    polygon = shapely.Polygon(building.footprint)
    if not polygon.is_valid or polygon.area <= 0:
        raise ValueError(f"footprint is not a simple polygon: {shapely.is_valid_reason(polygon)}")
    return shapely.orient_polygons(polygon)


def is_rectangle(corners: F64) -> bool:
    """Whether corners (n, 2) are a rectangle: four, with diagonals that halve each other and are equally long."""
    if len(corners) != 4:
        return False
    midpoints = math.hypot(*((corners[0] + corners[2]) / 2 - (corners[1] + corners[3]) / 2))
    lengths = math.hypot(*(corners[2] - corners[0])) - math.hypot(*(corners[3] - corners[1]))
    return bool(max(midpoints, abs(lengths)) <= RECTANGLE_TOLERANCE_M)


def _walls(count: int, top_start: int) -> I32:
    """Two triangles per edge between ring 0..count-1 below and the ring that starts at `top_start`."""
    low = np.arange(count, dtype=np.int32)
    following = (low + 1) % count
    high, high_following = low + top_start, following + top_start
    return np.stack([low, following, high_following, low, high_following, high], axis=-1).reshape(-1, 3)


def _prism(corners: F64, floor_m: float, top_m: float) -> tuple[F64, I32]:
    count = len(corners)
    vertices = np.concatenate([np.c_[corners, np.full(count, z)] for z in (floor_m, top_m)])
    cap = mapbox_earcut.triangulate_float64(corners, np.array([count], np.uint32)).reshape(-1, 3).astype(np.int32)
    return vertices, np.concatenate([_walls(count, count), cap + count, cap[:, ::-1]])


def _ridged(corners: F64, floor_m: float, eaves_m: float, ridge_m: float, hip: bool) -> tuple[F64, I32]:
    """A rectangle under a ridge along its longer side; hips draw the ridge's ends in by half the shorter side."""
    sides = math.hypot(*(corners[1] - corners[0])), math.hypot(*(corners[2] - corners[1]))
    ring = corners if sides[0] >= sides[1] else np.roll(corners, -1, axis=0)
    long_m, short_m = max(sides), min(sides)
    ends = np.stack([(ring[3] + ring[0]) / 2, (ring[1] + ring[2]) / 2])
    if hip:
        inset = min(short_m / 2, 0.45 * long_m) / long_m  # a square keeps a short ridge: no degenerate face
        ends = np.stack([ends[0] + inset * (ends[1] - ends[0]), ends[1] + inset * (ends[0] - ends[1])])
    levels = ((ring, floor_m), (ring, eaves_m), (ends, ridge_m))
    vertices = np.concatenate([np.c_[xy, np.full(len(xy), z)] for xy, z in levels])
    roof = [[4, 5, 9], [4, 9, 8], [6, 7, 8], [6, 8, 9], [5, 6, 9], [7, 4, 8], [0, 2, 1], [0, 3, 2]]
    return vertices, np.concatenate([_walls(4, 4), np.array(roof, np.int32)])


def top_height_m(building: Building, terrain: TerrainSpec) -> float:
    """Height of the building's highest point in the map frame: its height over the ground at its centroid."""
    centroid = footprint_polygon(building).centroid
    return float(ground_height_m(terrain, centroid.x, centroid.y)) + building.height_m


def building_mesh(building: Building, terrain: TerrainSpec) -> Mesh:
    """One closed mesh, normals outwards; gable and hip on other than rectangles are made flat."""
    corners = np.array(footprint_polygon(building).exterior.coords[:-1], np.float64)
    floor_m = float(ground_height_m(terrain, corners[:, 0], corners[:, 1]).min()) - SUNK_M
    top_m = top_height_m(building, terrain)
    roof_m = min(building.roof_height_m, building.height_m)
    if building.roof == "flat" or roof_m == 0 or not is_rectangle(corners):
        return Mesh(*_prism(corners, min(floor_m, top_m - SUNK_M), top_m))
    eaves_m = top_m - roof_m
    return Mesh(*_ridged(corners, min(floor_m, eaves_m - SUNK_M), eaves_m, top_m, building.roof == "hip"))
