"""The true surface and the noise-free scans of worlds whose surface is known in closed form."""

from __future__ import annotations

import math

import numpy as np
from orograph.grid import Grid
from orograph.scene import build_scene
from orograph.sensing.truth import dense_scans, top_surface

BLOCK = {"footprint": [[100, 100], [112, 100], [112, 110], [100, 110]], "height_m": 7.0}


def test_surface_of_a_block_on_flat_ground(flat_world):
    scene = build_scene(flat_world(buildings=[BLOCK]))
    height, occupied = top_surface(scene, Grid((95.0, 95.0), 5.0, (4, 5)))
    # Columns from 95: the block fills 100..110 and 2 m of 110..115; samples stand 0.625 + 1.25 k m inside a cell,
    # so 2 of 4 columns of samples lie below 2 m.
    share = np.zeros((4, 5))
    share[1:3, 1:3], share[1:3, 3] = 1.0, 0.5
    np.testing.assert_allclose(height, 7.0 * share, atol=1e-4)
    np.testing.assert_array_equal(occupied, share >= 0.4)
    assert height.dtype == np.float32


def test_steep_ground_is_occupied_and_sloping_ground_is_measured_at_its_mean(flat_world):
    gentle = build_scene(flat_world(terrain={"slope_x": 0.2, "slope_y": 0.1}))
    steep = build_scene(flat_world(terrain={"slope_x": 0.25, "slope_y": 0.25}))
    grid = Grid((50.0, 60.0), 0.5, (6, 8))
    height, occupied = top_surface(gentle, grid)
    x, y = np.meshgrid(*grid.centres_m())
    np.testing.assert_allclose(height, 0.2 * x + 0.1 * y, atol=1e-4)
    assert not occupied.any()
    assert top_surface(steep, grid)[1].all()


def test_surface_is_unknown_where_the_world_ends(flat_world):
    height, occupied = top_surface(build_scene(flat_world()), Grid((290.0, 0.0), 5.0, (1, 4)))
    np.testing.assert_array_equal(np.isnan(height), [[False, False, True, True]])
    assert not occupied.any()


def test_gable_is_seen_at_its_own_heights(flat_world):
    gable = {"footprint": [[100, 100], [120, 100], [120, 108], [100, 108]], "height_m": 9, "roof": "gable",
             "roof_height_m": 4}  # fmt: skip
    height, _ = top_surface(build_scene(flat_world(buildings=[gable])), Grid((105.0, 100.0), 1.0, (8, 4)), 2)
    centres = np.arange(8) + 0.5
    np.testing.assert_allclose(height, np.repeat(9 - np.abs(centres - 4)[:, None], 4, axis=1), atol=1e-4)


def test_dense_scans_meet_the_surfaces_without_noise(flat_world):
    # A noisy laser and a vehicle: the dense scans know neither.
    vehicle = {"loop": [[50, 50], [150, 50], [150, 150], [50, 150]]}
    noisy = {"rings": 16, "columns": 90, "noise_m": 0.5, "dropout": 0.5}
    world = flat_world(laser=noisy, terrain={"slope_x": 0.1}, buildings=[BLOCK], vehicles=[vehicle])
    poses = [(90.0, 105.0, 0.0), (106.0, 95.0, 2.0), (50.0, 55.0, -1.0)]
    scans = list(dense_scans(build_scene(world), poses, density=3))
    assert len(scans) == 3
    top_m = 0.1 * 106 + 7.0
    for (points, ranges_m, position), (x, y, _) in zip(scans, poses, strict=True):
        np.testing.assert_allclose(position, [x, y, 0.1 * x])
        assert points.shape == (len(ranges_m), 3)
        assert len(points) > 0.3 * 48 * 270
        off_ground = np.abs(points[:, 2] - 0.1 * points[:, 0])
        wall = np.minimum.reduce([np.abs(points[:, 0] - 100), np.abs(points[:, 0] - 112),
                                  np.abs(points[:, 1] - 100), np.abs(points[:, 1] - 110)])  # fmt: skip
        roof = np.abs(points[:, 2] - top_m)
        assert np.minimum.reduce([off_ground, wall, roof]).max() < 0.002
        eye = position + 0.45 * np.array([-0.1, 0, 1]) / math.sqrt(1.01)
        np.testing.assert_allclose(np.linalg.norm(points - eye, axis=1), ranges_m, atol=1e-4)
    assert (np.abs(scans[0][0][:, 0] - 100) < 0.002).sum() > 100, "the wall ahead"
