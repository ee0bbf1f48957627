"""Rays against plain-Python geometry: planes, boxes, and Moeller-Trumbore over all triangles."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from orograph.geometry import rotation
from orograph.scenario import Scenario
from orograph.scene import Mesh, build_scene
from orograph.sensing.bodies import NO_BOXES, Boxes
from orograph.sensing.casting import TILE_M, RayCaster
from orograph.sensing.ray_kernels import meet_boxes

REACH_M = 80.0
SEEDS = st.integers(0, 2**32 - 1)


def directions_of(seed: int, count: int):
    rays = np.random.default_rng(seed).normal(size=(count, 3))
    return (rays / np.linalg.norm(rays, axis=1)[:, None]).astype(np.float32)


def triangle_hits(origin, ray, triangles):
    """Moeller-Trumbore in float64, one ray against triangles (m, 3, 3): distances (m,), inf where it misses."""
    a, e1, e2 = triangles[:, 0], triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0]
    p, s = np.cross(ray, e2), origin - a
    q, det = np.cross(s, e1), (e1 * p).sum(axis=1)
    with np.errstate(divide="ignore", invalid="ignore"):
        u, v, t = (s * p).sum(axis=1) / det, (q @ ray) / det, (e2 * q).sum(axis=1) / det
        return np.where((u >= 0) & (v >= 0) & (u + v <= 1) & (t > 0), t, np.inf)


def edge_distance(origin, ray, triangles) -> float:
    """Smallest angle [rad] between the ray and a plane through an edge: where float32 may decide otherwise."""
    p = triangles - origin
    normals = np.cross(p, np.roll(p, -1, axis=1)).reshape(-1, 3)
    return float(np.min(np.abs(normals @ ray) / (np.linalg.norm(normals, axis=1) + 1e-12)))


def nearest_hits(origin, rays, triangles):
    nearest = [float(triangle_hits(origin, ray, triangles).min()) for ray in rays.astype(np.float64)]
    return [t if t < REACH_M else math.inf for t in nearest]


def cast(caster, origin, R, directions, boxes=NO_BOXES):
    return caster.distances(origin, R, np.ascontiguousarray(directions.T), boxes).copy()


def world(**fields) -> Scenario:
    return Scenario.model_validate(
        {"name": "rays", "title": "rays", "robots": 1, "starts": [{"x_m": 15, "y_m": 15}], "base_station_m": [15, 15],
         "patrol": [[15, 15]], "grid": {"rows": 40, "cols": 40}, "terrain": {"mesh_cell_m": 20}, **fields}
    )  # fmt: skip


class Triangles:
    """Stands for a scene: a few triangles as buildings over a ground far below."""

    def __init__(self, triangles) -> None:
        self.walls = Mesh(triangles.reshape(-1, 3), np.arange(3 * len(triangles), dtype=np.int32).reshape(-1, 3))
        corners = [(-500, -500, -500), (500, -500, -500), (500, 500, -500), (-500, 500, -500)]
        self.ground = Mesh(np.array(corners, np.float64), np.array([[0, 1, 2], [0, 2, 3]], np.int32))

    def meshes_in(self, rectangle_m):
        return self.ground, self.walls

    def height_m(self, x, y):
        return np.asarray(-500.0)


@settings(max_examples=40, deadline=None)
@given(SEEDS)
def test_random_triangles_as_moeller_and_trumbore_see_them(seed):
    draw = np.random.default_rng(seed)
    triangles = draw.uniform(-20, 20, (12, 1, 3)) + draw.uniform(-8, 8, (12, 3, 3))
    origin, R = draw.uniform(-20, 20, 3), rotation(*draw.uniform(-3, 3, 3))
    directions = directions_of(seed + 1, 60)
    seen = cast(RayCaster(Triangles(triangles), REACH_M), origin, R, directions)
    rays = directions.astype(np.float64) @ R.T
    for ray, got, expected in zip(rays, seen, nearest_hits(origin, rays, triangles), strict=True):
        if edge_distance(origin, ray, triangles) > 1e-4:
            assert got == pytest.approx(expected, abs=2e-3, rel=1e-4), f"seed {seed}"


@settings(max_examples=40, deadline=None)
@given(st.floats(-0.25, 0.25), st.floats(-0.25, 0.25), st.floats(20, 180), st.floats(20, 180), SEEDS)
def test_tilted_plane_in_closed_form(slope_x, slope_y, x, y, seed):
    scene = build_scene(world(terrain={"slope_x": slope_x, "slope_y": slope_y, "mesh_cell_m": 20}))
    origin = np.array([x, y, slope_x * x + slope_y * y + 0.5])
    directions = directions_of(seed, 100)
    seen = cast(RayCaster(scene, REACH_M), origin, np.eye(3), directions)
    closing = directions.astype(np.float64) @ [slope_x, slope_y, -1.0]  # [m/m] at which a ray loses height over ground
    expected = np.where(closing * REACH_M > 0.5, 0.5 / np.maximum(closing, 1e-9), np.inf)
    grazing = np.abs(closing) < 0.05
    # A ray that meets the ground at slope s turns 0.02 mm of height into 0.02 / s mm of distance.
    np.testing.assert_allclose(seen[~grazing], expected[~grazing], atol=1e-3)


def test_rays_along_edges_and_corners_do_not_slip_through():
    caster = RayCaster(build_scene(world(terrain={"mesh_cell_m": 2})), REACH_M)
    origin = np.array([100.0, 100.0, 1.0])  # above a corner of the mesh
    x, y = (a.reshape(-1) for a in np.meshgrid(np.arange(-30.0, 31.0), np.arange(-30.0, 31.0)))
    rays = np.stack([x, y, np.full_like(x, -1.0)], axis=-1)
    length = np.linalg.norm(rays, axis=1)
    seen = cast(caster, origin, np.eye(3), (rays / length[:, None]).astype(np.float32))
    np.testing.assert_allclose(seen, length, atol=2e-3)


def box_triangles(centre, half, R_map_box):
    corners = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)]) * half @ R_map_box.T + centre
    quads = [(0, 1, 3, 2), (4, 5, 7, 6), (0, 1, 5, 4), (2, 3, 7, 6), (0, 2, 6, 4), (1, 3, 7, 5)]
    return np.array([corners[list(t)] for a, b, c, d in quads for t in ((a, b, c), (a, c, d))])


@settings(max_examples=40, deadline=None)
@given(SEEDS, st.integers(1, 4))
def test_boxes_as_their_twelve_triangles(seed, count):
    draw = np.random.default_rng(seed)
    centres, half = draw.uniform(-6, 6, (count, 3)), draw.uniform(0.3, 5, (count, 3))  # some hold the origin
    turns = [rotation(*draw.uniform(-3, 3, 3)) for _ in range(count)]
    rays = directions_of(seed + 1, 60)
    distances = np.full(len(rays), np.inf)
    R_box_map = np.ascontiguousarray(np.stack([R.T for R in turns]))
    meet_boxes(np.ascontiguousarray(rays.T), centres, half, R_box_map, REACH_M, distances)
    triangles = np.concatenate([box_triangles(*box) for box in zip(centres, half, turns, strict=True)])
    for ray, got, expected in zip(rays, distances, nearest_hits(np.zeros(3), rays, triangles), strict=True):
        if edge_distance(np.zeros(3), ray, triangles) > 1e-6:
            assert got == pytest.approx(expected, rel=1e-5), f"seed {seed}"


def test_axis_aligned_rays_beside_and_through_a_box():
    box = np.array([[5.0, 0.0, 0.0]]), np.array([[1.0, 1.0, 1.0]]), np.eye(3)[None]
    rays = np.array([[1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, 0, 1]], np.float32)
    distances = np.full(4, np.inf)
    meet_boxes(np.ascontiguousarray(rays.T), *box, REACH_M, distances)
    np.testing.assert_array_equal(distances, [4, np.inf, np.inf, np.inf])


def test_the_nearer_of_building_and_box_counts():
    wall = {"footprint": [[120, 50], [125, 50], [125, 150], [120, 150]], "height_m": 10}
    caster = RayCaster(build_scene(world(buildings=[wall])), REACH_M)
    origin, ahead = np.array([100.0, 100.0, 1.0]), np.array([[1, 0, 0]], np.float32)
    before = Boxes(np.array([[110.0, 100, 1]]), np.ones((1, 3)), np.eye(3)[None])
    behind = Boxes(np.array([[135.0, 100, 1]]), np.ones((1, 3)), np.eye(3)[None])
    assert cast(caster, origin, np.eye(3), ahead) == pytest.approx([20.0])
    assert cast(caster, origin, np.eye(3), ahead, before) == pytest.approx([9.0])
    assert cast(caster, origin, np.eye(3), ahead, behind) == pytest.approx([20.0])


def test_building_on_a_hillside_is_met_by_rising_and_by_falling_rays():
    wall = {"footprint": [[120, 50], [125, 50], [125, 150], [120, 150]], "height_m": 30}
    caster = RayCaster(build_scene(world(buildings=[wall], terrain={"slope_x": 0.1, "mesh_cell_m": 5})), REACH_M)
    rays = np.array([[math.cos(e), 0, math.sin(e)] for e in np.radians([-30, 0, 7, 20, 40, 80])], np.float32)
    seen = cast(caster, np.array([100.0, 100.0, 10.5]), np.eye(3), rays)
    # Falling 30 deg: 0.5 m over ground that rises 0.1 in 1; then the wall 20 m ahead; the last passes over it.
    expected = [0.5 / (0.5 + 0.1 * rays[0, 0]), 20, *(20 / rays[i, 0] for i in (2, 3, 4)), np.inf]
    # Level: the ground, 0.5 m lower and rising by 0.1, is met after 5 m; at 7 degrees (0.123) it is not.
    expected[1] = 5.0
    np.testing.assert_allclose(seen, expected, rtol=1e-4)


def test_what_a_ray_meets_does_not_depend_on_where_the_caster_was_before():
    blocks = [
        {"footprint": [[x, y], [x + 9, y], [x + 7, y + 8], [x, y + 8]], "height_m": 6}
        for x in (60, 110)
        for y in (60, 110)
    ]
    terrain = {"waves": [{"amplitude_m": 2, "wavelength_m": 70}], "mesh_cell_m": 5}
    scene = build_scene(world(buildings=blocks, terrain=terrain))
    directions, places = directions_of(7, 500), [(x, 102.0) for x in np.arange(40.0, 160.0, TILE_M / 4)]
    travelled = RayCaster(scene, REACH_M)
    for x, y in [*places, *places[::-1]]:
        origin = np.array([x, y, float(scene.height_m(x, y)) + 0.45])
        fresh = cast(RayCaster(scene, REACH_M), origin, np.eye(3), directions)
        np.testing.assert_array_equal(cast(travelled, origin, np.eye(3), directions), fresh)
