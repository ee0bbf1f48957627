"""The ground against hand-computed heights, and its mesh against the ground."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from orograph.grid import Grid
from orograph.scenario import TerrainSpec, Wave
from orograph.scene.terrain import MARGIN_M, ground_gradient, ground_height_m, terrain_mesh

HILLS = TerrainSpec(
    height_m=3.0, slope_x=0.1, slope_y=-0.05, mesh_cell_m=4.0,
    waves=(Wave(amplitude_m=2.0, wavelength_m=40.0, heading_deg=90.0, phase_deg=30.0),
           Wave(amplitude_m=1.0, wavelength_m=75.0, heading_deg=-20.0)),
)  # fmt: skip
GRID = Grid((10.0, -20.0), 5.0, (8, 12))
coordinates = st.floats(-500, 500)


def test_plane_by_hand():
    plane = TerrainSpec(height_m=3.0, slope_x=0.1, slope_y=-0.05)
    np.testing.assert_allclose(ground_height_m(plane, [0.0, 10.0, 10.0], [0.0, 0.0, 20.0]), [3.0, 4.0, 3.0])


def test_wave_crest_and_trough_lie_along_its_heading():
    north = TerrainSpec(waves=(Wave(amplitude_m=2.0, wavelength_m=40.0, heading_deg=90.0),))
    heights = ground_height_m(north, [0.0, 7.0, 0.0, -3.0], [0.0, 10.0, 20.0, 30.0])
    np.testing.assert_allclose(heights, [0.0, 2.0, 0.0, -2.0], atol=1e-12)


@settings(deadline=None)
@given(coordinates, coordinates)
def test_gradient_is_the_heights_difference_quotient(x, y):
    step = 1e-4
    along_x = (ground_height_m(HILLS, x + step, y) - ground_height_m(HILLS, x - step, y)) / (2 * step)
    along_y = (ground_height_m(HILLS, x, y + step) - ground_height_m(HILLS, x, y - step)) / (2 * step)
    # Truncation is about step^2, rounding about 1e-14 * 100 m / step.
    assert ground_gradient(HILLS, x, y) == pytest.approx((along_x, along_y), abs=1e-7)


def test_gradient_takes_the_points_shape():
    gx, gy = ground_gradient(TerrainSpec(slope_x=0.2), np.zeros((2, 3)), np.zeros((2, 3)))
    np.testing.assert_array_equal(gx, np.full((2, 3), 0.2))
    np.testing.assert_array_equal(gy, np.zeros((2, 3)))


def test_mesh_lies_on_the_ground_faces_up_and_reaches_the_margin():
    mesh = terrain_mesh(HILLS, GRID)
    x, y, z = mesh.vertices.T
    np.testing.assert_array_equal(z, ground_height_m(HILLS, x, y))
    a, b, c = (mesh.vertices[mesh.faces[:, i]] for i in range(3))
    assert (np.cross(b - a, c - a)[:, 2] > 0).all()
    assert (x.min(), y.min()) == (10 - MARGIN_M, -20 - MARGIN_M)
    assert (x.max(), y.max()) == (70 + MARGIN_M, 20 + MARGIN_M)


def test_mesh_covers_its_area_once():
    mesh = terrain_mesh(HILLS, GRID)
    a, b, c = (mesh.vertices[mesh.faces[:, i], :2] for i in range(3))
    (ux, uy), (vx, vy) = (b - a).T, (c - a).T
    assert (0.5 * (ux * vy - uy * vx)).sum() == pytest.approx((60 + 2 * MARGIN_M) * (40 + 2 * MARGIN_M))


def triangles(mesh) -> set[tuple[float, ...]]:
    return {tuple(mesh.vertices[face].reshape(-1).tolist()) for face in mesh.faces}


WHOLE = triangles(terrain_mesh(HILLS, GRID))


@settings(deadline=None)
@given(st.floats(-90, 165), st.floats(-120, 115), st.floats(0.1, 60), st.floats(0.1, 60))
def test_part_holds_the_same_triangles_and_covers_its_rectangle(x, y, width, height):
    part = terrain_mesh(HILLS, GRID, (x, y, x + width, y + height))
    assert triangles(part) <= WHOLE
    (x0, y0), (x1, y1) = part.vertices[:, :2].min(axis=0), part.vertices[:, :2].max(axis=0)
    assert x0 <= x
    assert y0 <= y
    assert x1 >= min(x + width, 70 + MARGIN_M)
    assert y1 >= min(y + height, 20 + MARGIN_M)
    assert x1 <= x + width + 10 + 1e-9, "no more than one mesh cell beyond"


def test_steps_of_the_mesh_stay_near_the_exact_ground():
    mesh = terrain_mesh(HILLS, GRID)
    middle = mesh.vertices[mesh.faces].mean(axis=1)
    inside = (np.abs(middle[:, 0] - 40) < 30) & (np.abs(middle[:, 1]) < 20)
    error = middle[inside, 2] - ground_height_m(HILLS, middle[inside, 0], middle[inside, 1])
    # Sagitta of the steepest sine over a cell: amplitude * (2 pi / wavelength)^2 * cell^2 / 8, summed over the waves.
    bound = sum(w.amplitude_m * (2 * math.pi / w.wavelength_m) ** 2 * 2 * HILLS.mesh_cell_m**2 / 8 for w in HILLS.waves)
    assert np.abs(error).max() < bound
