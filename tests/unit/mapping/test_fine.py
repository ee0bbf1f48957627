"""Fine blocks that roll out of the window come back whole: as if the window had been large enough from the start."""

from __future__ import annotations

import numpy as np
import pytest
from orograph.grid import Grid
from orograph.mapping import RobotMapper
from orograph.rules import NAMED, SURFACE

CELL_M, BLOCK = 0.5, 10


def mapped(rules: str, blocks: int, origin_m: tuple[float, float] = (0.0, 0.0)) -> RobotMapper:
    """A drive of 60 m and back, of sparse scans that reach 12 m, over steps and slopes."""
    block_m = CELL_M * BLOCK
    grid = Grid(origin_m, block_m, (1, 1))
    mapper = RobotMapper(grid, blocks * BLOCK, BLOCK, NAMED[rules], range_max_m=12.0, keep_fine=True)
    way_m = np.concatenate([np.linspace(0, 60, 25), np.linspace(60, 0, 25)])
    for i, x_m in enumerate(way_m):
        random = np.random.default_rng(i)
        around_m = random.uniform(-8, 8, (3000, 2)) + np.array([x_m, 0.0])
        height_m = 0.1 * around_m[:, 0] + 2.0 * (np.abs(around_m[:, 1]) > 6) * random.uniform(size=3000)
        points = np.column_stack([around_m, height_m])
        eye_m = np.array([x_m, 0.0, 0.1 * x_m + 1.5])
        ranges_m = np.linalg.norm(points - eye_m, axis=1)
        shift_m = np.array([*origin_m, 0.0])
        mapper.step(points + shift_m, ranges_m, eye_m + shift_m, i * 400_000_000)
    return mapper


@pytest.mark.parametrize("rules", ["paper", "surface"])
def test_a_small_window_maps_what_a_large_one_does(rules: str) -> None:
    small, large = mapped(rules, 6).fine(), mapped(rules, 40).fine()
    rows, cols = small.grid.rows_cols(np.array(large.grid.centre_m(0, 0)))
    row, col = -int(rows), -int(cols)
    assert small.known.sum() == large.known.sum() > 3000
    for name, layer in small.layers():
        cut = dict(large.layers())[name][row : row + small.grid.rows, col : col + small.grid.cols]
        assert np.allclose(layer, cut, rtol=0, atol=1e-5, equal_nan=True), name


@pytest.mark.parametrize(("most", "whole"), [(20_000, True), (3, False)])
def test_a_robot_finds_what_it_left_as_fine_as_it_was(most: int, whole: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    """Sixty metres away and back: the wall's own cells, not its block's mean; unless too much was seen meanwhile."""
    monkeypatch.setattr("orograph.mapping.mapper.FINE_KEPT", most)
    robot, seen = RobotMapper(Grid((0.0, 0.0), 5.0, (8, 40)), 60, 10, SURFACE, 20.0), []
    for i, x_m in enumerate([20.0, 20.0, 50.0, 80.0, 50.0, 20.0]):
        y, z = (axis.ravel() for axis in np.meshgrid(np.arange(16, 24, 0.1), np.arange(0.05, 3, 0.1)))
        points = np.column_stack([np.full(y.size, x_m + 6.2), y, z]) if i != 5 else np.zeros((0, 3))
        eye_m = np.array([x_m, 20.0, 1.0])
        robot.step(points, np.linalg.norm(points - eye_m, axis=1), eye_m, i * 400_000_000)
        seen.append(robot.evidence.by_name["wall_share"])
    assert np.array_equal(seen[1], seen[5]) == whole


def test_utm_keeps_its_millimetres() -> None:
    """The same drive at northing 4 million: cell for cell the same heights, to 0.1 mm."""
    here, there = mapped("surface", 6).fine(), mapped("surface", 6, (385_000.0, 6_672_000.0)).fine()
    assert there.grid.origin_m == (here.grid.origin_m[0] + 385_000.0, here.grid.origin_m[1] + 6_672_000.0)
    both = here.known & there.known
    assert both.sum() > 0.999 * here.known.sum()
    assert np.nanmax(np.abs(here.height - there.height)[both]) < 1e-4
