"""The map's triangles: where corners lie, where walls stand, and that tiles together are the whole."""

from __future__ import annotations

import numpy as np
import pytest
from orograph.console.surface import Mesh, Surface, tiles, touched
from orograph.grid import Grid

GRID = Grid((100.0, 200.0), 5.0, (45, 50))


def whole(height_m: np.ndarray, grid: Grid = GRID) -> Mesh:
    return Surface(grid, height_m).mesh(slice(0, grid.rows), slice(0, grid.cols))


def normals(mesh: Mesh) -> np.ndarray:
    a, b, c = (mesh.vertices[mesh.faces[:, i]].astype(np.float64) for i in range(3))
    return np.cross(b - a, c - a)


def test_a_slope_is_smooth_and_has_no_walls() -> None:
    x, y = np.meshgrid(*GRID.centres_m())
    mesh = whole(0.05 * x - 0.1 * y)
    assert len(mesh.faces) == 2 * GRID.size
    inner = (np.abs(mesh.vertices[:, 0] - 225) < 100) & (
        np.abs(mesh.vertices[:, 1] - 312) < 90
    )  # at the rim there is nobody to share a corner with
    corner = mesh.vertices[inner].astype(np.float64)
    np.testing.assert_allclose(corner[:, 2], 0.05 * corner[:, 0] - 0.1 * corner[:, 1], atol=1e-3)
    assert (normals(mesh)[:, 2] > 0).all()


def test_a_block_stands_between_four_walls_of_its_own_cells() -> None:
    height_m = np.zeros(GRID.shape)
    height_m[10:13, 20:24] = 9.0
    mesh = whole(height_m)
    walls = mesh.faces[np.abs(normals(mesh)[:, 2]) < 1e-6]
    assert len(walls) == 2 * 2 * (3 + 4)
    rows, cols = np.divmod(mesh.cells[walls].reshape(-1), GRID.cols)
    assert set(rows) <= set(range(10, 13)) and set(cols) <= set(range(20, 24))
    assert set(mesh.vertices[walls].reshape(-1, 3)[:, 2]) == {0.0, 9.0}


def test_what_is_unknown_is_a_hole() -> None:
    height_m = np.zeros(GRID.shape)
    height_m[4, 5] = np.nan
    mesh = whole(height_m)
    assert len(mesh.faces) == 2 * (GRID.size - 1) and 4 * GRID.cols + 5 not in mesh.cells
    assert np.isfinite(mesh.vertices).all()


def test_tiles_together_are_the_whole() -> None:
    height_m = np.random.default_rng(3).choice([0.0, 0.3, 7.0], GRID.shape)
    surface = Surface(GRID, height_m)
    parts = [surface.mesh(*place) for place in tiles(GRID).values()]
    assert sum(len(part.faces) for part in parts) == len(whole(height_m).faces)
    assert sorted(set(np.concatenate([part.cells for part in parts]))) == list(range(GRID.size))


@pytest.mark.parametrize(
    ("cell", "places"),
    [
        ((5, 5), {(0, 0)}),
        ((20, 5), {(0, 0), (1, 0)}),
        ((19, 39), {(0, 1), (0, 2), (1, 1), (1, 2)}),
        ((44, 49), {(2, 2)}),
    ],
)
def test_a_changed_cell_touches_the_tiles_whose_corners_it_moves(
    cell: tuple[int, int], places: set[tuple[int, int]]
) -> None:
    changed = np.zeros(GRID.shape, np.bool_)
    changed[cell] = True
    assert set(touched(changed)) == places
    before, after = np.zeros(GRID.shape), np.zeros(GRID.shape)
    after[cell] = 0.5
    differ = {
        place for place, (rows, cols) in tiles(GRID).items()
        if not np.array_equal(Surface(GRID, before).mesh(rows, cols).vertices,
                              Surface(GRID, after).mesh(rows, cols).vertices)
    }  # fmt: skip
    assert differ <= places
