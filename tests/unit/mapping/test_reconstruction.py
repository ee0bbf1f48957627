"""reconstruct: hand-computed cases, edges, and the plain-Python oracle."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from oracles import mapping_oracle as oracle
from orograph.grid import Grid
from orograph.layers import BASIC_LAYERS, CellMap
from orograph.mapping import reconstruct
from orograph.mapping.cells import unknown_values
from orograph.mapping.reconstruction import Reconstructor
from orograph.rules import PAPER

GRID = Grid((10.0, -5.0), 0.5, (8, 12))
NOTHING = unknown_values(0), np.zeros(0, np.bool_)
"""What is held and raised; rules of one surface ask neither."""
CORNERS = np.array([[0.1, 0.1], [0.4, 0.1], [0.1, 0.4], [0.4, 0.4]])


NEAR_M = 1e-9
"""The nearest range that counts, where f(D) is 1."""


def in_cell(row: int, col: int, z_m, places=CORNERS) -> np.ndarray:
    """Points at `places` (n, 2) [m] within a cell of GRID."""
    x0, y0 = GRID.origin_m
    z = np.broadcast_to(z_m, len(places))
    return np.column_stack([x0 + col * 0.5 + places[:, 0], y0 + row * 0.5 + places[:, 1], z])


def assert_cells(found: CellMap, expected: oracle.Cells, rtol: float = 2e-6, atol: float = 2e-6) -> None:
    """Sums in another order and float32 storage (6e-8) are all that may differ; thin planes magnify that."""
    wanted = np.full((len(BASIC_LAYERS), *found.grid.shape), np.nan, np.float32)
    wanted[-1] = 0.0
    for place, cell in expected.items():
        wanted[(slice(None), *place)] = cell
    for name, layer in zip(BASIC_LAYERS, wanted, strict=True):
        np.testing.assert_allclose(getattr(found, name), layer, rtol=rtol, atol=atol, err_msg=name)


def test_a_plane_is_found_with_its_height_at_the_centroid():
    z = 3.0 + 0.2 * (CORNERS[:, 0] - 0.25) - 0.1 * (CORNERS[:, 1] - 0.25)
    cell_map = reconstruct(in_cell(2, 3, z), np.full(4, 8.0), GRID, 80.0)
    assert cell_map.height[2, 3] == pytest.approx(3.0, abs=1e-6)
    assert cell_map.gradient_x[2, 3] == pytest.approx(0.2, abs=1e-6)
    assert cell_map.gradient_y[2, 3] == pytest.approx(-0.1, abs=1e-6)
    assert cell_map.occupation[2, 3] == pytest.approx(np.hypot(0.2, 0.1) / 0.3, abs=1e-6)
    assert cell_map.known.sum() == 1 and np.isnan(cell_map.height).sum() == GRID.size - 1


def test_occupation_ends_at_one_and_follows_the_robots_slope():
    z = 0.9 * CORNERS[:, 0]
    assert reconstruct(in_cell(0, 0, z), np.full(4, 8.0), GRID, 80.0).occupation[0, 0] == 1.0
    gentle = reconstruct(in_cell(0, 0, z), np.full(4, 8.0), GRID, 80.0, slope_max=1.8)
    assert gentle.occupation[0, 0] == pytest.approx(0.5, abs=1e-6)


@pytest.mark.parametrize(("distance_m", "factor"), [(NEAR_M, 1.0), (30.0, 0.9), (60.0, 0.8), (68.0, 0.7), (80.0, 0.55)])
def test_confidence_falls_with_distance_as_equation_10_is_read(distance_m, factor):
    cell_map = reconstruct(in_cell(1, 1, 0.0), np.full(4, distance_m), GRID, 80.0)
    assert cell_map.confidence[1, 1] == pytest.approx(255 * 4 / 16 * factor, rel=1e-6)


def test_confidence_counts_each_hit_sub_cell_once_and_reaches_255():
    same = np.array([[0.01, 0.01], [0.02, 0.11], [0.12, 0.0]])
    sixteen = np.array([[0.0625 + 0.125 * i, 0.0625 + 0.125 * j] for i in range(4) for j in range(4)])
    cell_map = reconstruct(
        np.vstack([in_cell(0, 0, 0.0, same), in_cell(1, 0, 0.0, sixteen)]), np.full(19, NEAR_M), GRID, 80.0
    )
    assert cell_map.confidence[0, 0] == pytest.approx(255 / 16)
    assert cell_map.confidence[1, 0] == 255.0


def test_a_point_on_a_shared_edge_belongs_above_and_right_and_the_outer_edge_is_outside():
    points = np.array([[10.0, -5.0, 1.0], [10.5, -4.5, 2.0], [16.0, -4.9, 3.0], [10.1, -1.0, 4.0], [9.9999, -5.0, 5.0]])
    maker = Reconstructor(GRID.size, 80.0, PAPER.real(0.3))
    cells, values, _ = maker.aux(points, np.ones(5), GRID, *NOTHING)
    assert cells.tolist() == [0, 13]
    assert values[:, 0].tolist() == [1.0, 2.0]
    assert maker.dropped.tolist() == [0, 0, 3]


def test_a_sub_cells_edge_belongs_above_and_right():
    on_edges = np.array([[0.0, 0.0], [0.125, 0.0], [0.125, 0.125], [0.25, 0.375]])
    assert reconstruct(in_cell(0, 0, 0.0, on_edges), np.full(4, NEAR_M), GRID, 80.0).confidence[0, 0] == 255 * 4 / 16


def test_what_is_not_finite_or_beyond_range_is_dropped_and_counted():
    points = in_cell(0, 0, 0.0, np.tile(CORNERS, (2, 1)))
    ranges_m = np.full(8, 80.0)
    points[0, 2], points[1, 0], points[2, 1], ranges_m[3] = np.nan, np.inf, -np.inf, np.nan
    ranges_m[4] = np.nextafter(80.0, 81.0)
    points[5, 0] = 1e300
    maker = Reconstructor(GRID.size, 80.0, PAPER.real(0.3))
    cells, _, _ = maker.aux(points, ranges_m, GRID, *NOTHING)
    assert cells.tolist() == [0]
    assert maker.dropped.tolist() == [4, 1, 1]
    assert not reconstruct(points[:6], ranges_m[:6], GRID, 80.0).known.any()


def test_gradients_come_from_neighbours_where_points_cannot_carry_a_plane():
    one = np.array([[0.25, 0.25]])
    points = np.vstack([in_cell(3, c, z, one) for c, z in ((2, 1.0), (3, 1.1), (4, 1.4))] + [in_cell(4, 4, 2.0, one)])
    cell_map = reconstruct(points, np.ones(4), GRID, 80.0)
    np.testing.assert_allclose(cell_map.gradient_x[3, 2:5], [0.2, 0.4, 0.6], rtol=1e-6)
    assert np.isnan(cell_map.gradient_y[3, 2:4]).all() and np.isnan(cell_map.occupation[3, 2:4]).all()
    assert cell_map.gradient_y[3, 4] == pytest.approx(1.2) and cell_map.gradient_y[4, 4] == pytest.approx(1.2)
    assert np.isnan(cell_map.gradient_x[4, 4])


def test_neighbours_do_not_reach_around_the_grids_edge():
    one = np.array([[0.25, 0.25]])
    points = np.vstack([in_cell(0, GRID.cols - 1, 1.0, one), in_cell(1, 0, 5.0, one)])
    assert np.isnan(reconstruct(points, np.ones(2), GRID, 80.0).gradient_x).all()


@pytest.mark.parametrize(("width_m", "carries"), [(0.0249, False), (0.0251, True)])
def test_the_degenerate_spread_begins_at_a_twentieth_of_the_cell(width_m, carries):
    """Four points at +-width in x have the variance width^2 there; (0.5 / 20)^2 = 0.025^2 is the bound."""
    places = np.array([[0.25 - width_m, 0.1], [0.25 + width_m, 0.1], [0.25 - width_m, 0.4], [0.25 + width_m, 0.4]])
    cell_map = reconstruct(in_cell(2, 2, places[:, 0], places), np.ones(4), GRID, 80.0)
    assert np.isnan(cell_map.gradient_x[2, 2]) != carries
    if carries:
        assert cell_map.gradient_x[2, 2] == pytest.approx(1.0, abs=1e-6)


def test_two_points_and_points_in_a_line_carry_no_plane():
    line = np.array([[0.1, 0.1], [0.2, 0.2], [0.4, 0.4]])
    points = np.vstack([in_cell(0, 0, line[:, 0], line), in_cell(4, 4, line[:2, 0], line[:2])])
    assert np.isnan(reconstruct(points, np.ones(5), GRID, 80.0).gradient_x).all()


def test_no_points_make_an_empty_map_and_a_workspace_forgets_the_last_scan():
    assert reconstruct(np.zeros((0, 3)), np.zeros(0), GRID, 80.0).equals(CellMap.unknown(GRID))
    maker = Reconstructor(GRID.size, 80.0, PAPER.real(0.3))
    for z_m in (1.0, 2.0, 3.0):
        cells, values, _ = maker.aux(in_cell(2, 3, z_m), np.ones(4), GRID, *NOTHING)
        assert cells.tolist() == [2 * GRID.cols + 3] and values[0, 0] == z_m


def test_no_positive_range_is_no_measurement():
    points = in_cell(1, 1, 0.0)
    assert not reconstruct(points, np.array([0.0, -1.0, -1000.0, -1e9]), GRID, 80.0).known.any()


coordinate = st.floats(-0.4, 4.4).map(lambda v: round(v * 64) / 64) | st.floats(-0.4, 4.4)
point = st.tuples(coordinate, coordinate, st.floats(-3, 30), st.floats(1e-6, 85))


@settings(max_examples=150, deadline=None)
@given(st.lists(point, max_size=120), st.sampled_from([(0.0, 0.0), (4_000.5, -7_123.0)]), st.booleans())
def test_equals_the_oracle(points, origin, single):
    """Coordinates lie often on edges of cells and sub-cells, far from the origin and as float32 too."""
    values = np.array(points, np.float64).reshape(-1, 4) + np.array([*origin, 0.0, 0.0])
    xyz, ranges_m = values[:, :3], values[:, 3].astype(np.float32)
    xyz = xyz.astype(np.float32) if single else xyz
    grid = Grid(origin, 0.5, (8, 8))
    expected, dropped = oracle.reconstruct(xyz, ranges_m, origin, 0.5, grid.shape, 80.0)
    assert_cells(reconstruct(xyz, ranges_m, grid, 80.0), expected, rtol=1e-5, atol=1e-5)
    maker = Reconstructor(grid.size, 80.0, PAPER.real(0.3))
    maker.aux(xyz, ranges_m, grid, *NOTHING)
    assert maker.dropped.tolist() == dropped
