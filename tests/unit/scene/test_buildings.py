"""Buildings' volumes, tops and closedness against closed formulas."""

from __future__ import annotations

from collections import Counter

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from orograph.scenario import Building, Scenario, TerrainSpec
from orograph.scene import build_scene
from orograph.scene.buildings import SUNK_M, building_mesh, is_rectangle
from orograph.scene.mesh import joined

FLAT = TerrainSpec(height_m=1.0)
RECTANGLE = ((0.0, 0.0), (20.0, 0.0), (20.0, 8.0), (0.0, 8.0))
L_SHAPE = ((0.0, 0.0), (10.0, 0.0), (10.0, 4.0), (4.0, 4.0), (4.0, 12.0), (0.0, 12.0))


def volume(mesh) -> float:
    """Divergence theorem, one tetrahedron per face; positive when normals point outwards."""
    return sum(float(np.dot(a, np.cross(b, c))) / 6 for a, b, c in mesh.vertices[mesh.faces])


def assert_closed(mesh):
    edges = Counter((int(f[i]), int(f[(i + 1) % 3])) for f in mesh.faces for i in range(3))
    assert all(n == 1 and edges[(b, a)] == 1 for (a, b), n in edges.items()), "each edge once in each direction"


def turned(corners, angle_rad: float, shift: tuple[float, float]):
    c, s = np.cos(angle_rad), np.sin(angle_rad)
    return tuple((c * x - s * y + shift[0], s * x + c * y + shift[1]) for x, y in corners)


@pytest.mark.parametrize("corners", [RECTANGLE, RECTANGLE[::-1], L_SHAPE, L_SHAPE[::-1]])
def test_flat_roof_is_a_prism(corners):
    mesh = building_mesh(Building(footprint=corners, height_m=6.0), FLAT)
    area = 160.0 if len(corners) == 4 else 72.0
    assert_closed(mesh)
    assert volume(mesh) == pytest.approx(area * (6.0 + SUNK_M))
    assert (mesh.vertices[:, 2].min(), mesh.vertices[:, 2].max()) == (1.0 - SUNK_M, 7.0)


@settings(deadline=None)
@given(st.floats(0, 7), st.integers(0, 3), st.booleans())
def test_ridged_roofs_have_their_closed_volumes(angle_rad, first, clockwise):
    corners = turned(RECTANGLE, angle_rad, (300.0, 200.0))
    corners = corners[first:] + corners[:first]
    corners = corners[::-1] if clockwise else corners
    below = 160.0 * (4.0 + SUNK_M)
    gable = building_mesh(Building(footprint=corners, height_m=7.0, roof="gable", roof_height_m=3.0), FLAT)
    hip = building_mesh(Building(footprint=corners, height_m=7.0, roof="hip", roof_height_m=3.0), FLAT)
    for mesh in (gable, hip):
        assert_closed(mesh)
        assert mesh.vertices[:, 2].max() == 8.0
    for mesh, ridge_m in ((gable, 20.0), (hip, 20.0 - 8.0)):
        ends = mesh.vertices[mesh.vertices[:, 2] == 8.0]
        assert np.linalg.norm(ends[0] - ends[1]) == pytest.approx(ridge_m), "along the longer side"
    # 1e-4: the formula sums tetrahedra of 300 m from the origin.
    assert volume(gable) == pytest.approx(below + 160.0 * 3.0 / 2, rel=1e-4)
    assert volume(hip) == pytest.approx(below + 3.0 * 8.0 * (2 * 20.0 + 12.0) / 6, rel=1e-4)


def test_square_hip_has_no_degenerate_face():
    square = ((0.0, 0.0), (10.0, 0.0), (10.0, 10.0), (0.0, 10.0))
    mesh = building_mesh(Building(footprint=square, height_m=7.0, roof="hip", roof_height_m=3.0), FLAT)
    a, b, c = (mesh.vertices[mesh.faces[:, i]] for i in range(3))
    assert np.linalg.norm(np.cross(b - a, c - a), axis=1).min() > 1e-3
    assert_closed(mesh)


def test_gable_on_another_shape_is_flat():
    mesh = building_mesh(Building(footprint=L_SHAPE, height_m=6.0, roof="gable", roof_height_m=2.0), FLAT)
    assert volume(mesh) == pytest.approx(72.0 * (6.0 + SUNK_M))


def test_stands_on_a_slope_without_a_gap():
    slope = TerrainSpec(slope_x=0.2)
    mesh = building_mesh(Building(footprint=RECTANGLE, height_m=6.0), slope)
    assert mesh.vertices[:, 2].max() == pytest.approx(0.2 * 10.0 + 6.0), "above the ground at the centroid"
    assert mesh.vertices[:, 2].min() == pytest.approx(0.0 - SUNK_M), "below the lowest corner"


def test_low_building_on_a_steep_slope_is_still_closed_upwards():
    mesh = building_mesh(Building(footprint=RECTANGLE, height_m=0.5), TerrainSpec(slope_x=0.3))
    assert volume(mesh) > 0


@pytest.mark.parametrize(
    ("corners", "expected"),
    [
        (RECTANGLE, True),
        (turned(RECTANGLE, 1.1, (5.0, 5.0)), True),
        (L_SHAPE, False),
        (((0.0, 0.0), (20.0, 0.0), (23.0, 8.0), (3.0, 8.0)), False),
        (((0.0, 0.0), (20.0, 0.0), (18.0, 8.0), (2.0, 8.0)), False),
    ],
)
def test_rectangles_are_told_from_other_shapes(corners, expected):
    assert is_rectangle(np.array(corners)) is expected


def scenario_with(*buildings: Building) -> Scenario:
    return Scenario.model_validate(
        {"name": "town", "title": "town", "robots": 1, "starts": [{"x_m": 50, "y_m": 50}], "base_station_m": [50, 50],
         "patrol": [[50, 50]], "buildings": buildings}
    )  # fmt: skip


@pytest.mark.parametrize(
    ("rectangle_m", "touched"),
    [((5, 2, 6, 3), [0]), ((-9, -9, 90, 90), [0, 1]), ((20, 8, 25, 30), [0]), ((21, 0, 90, 8), []),
     ((0, 40, 9, 90), [1]),
     ((0, 9, 90, 39), []), ((60, 40, 70, 50), []), ((0, 52.1, 90, 60), []), ((5, 30, 6, 60), [1])],
)  # fmt: skip
def test_a_rectangle_finds_the_buildings_that_touch_it(rectangle_m, touched):
    north = Building(footprint=tuple((x, y + 40) for x, y in L_SHAPE), height_m=5.0)
    scene = build_scene(scenario_with(Building(footprint=RECTANGLE, height_m=6.0), north))
    _, found = scene.meshes_in(rectangle_m)
    expected = joined([scene.building_meshes[i] for i in touched])
    np.testing.assert_array_equal(found.vertices, expected.vertices)
    np.testing.assert_array_equal(found.faces, expected.faces)


def test_bad_footprint_is_named():
    bow_tie = Building(footprint=((0, 0), (10, 10), (10, 0), (0, 10)), height_m=5.0)
    good = Building(footprint=RECTANGLE, height_m=5.0)
    with pytest.raises(ValueError, match=r"buildings\[1\]: footprint is not a simple polygon"):
        build_scene(scenario_with(good, bow_tie))
