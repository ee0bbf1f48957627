"""The rule set `surface` on a robot: two surfaces, what stands, seeing through, and what planning is told."""

from collections import defaultdict

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from made_up.cells import GATED
from oracles.mapping_oracle import distance_factor
from oracles.surface_oracle import parted
from orograph.geometry import ray_directions
from orograph.grid import Grid
from orograph.layers import CONFIDENCE, CONFIDENCE_TOP, FREE_SHARE, HEIGHT, HEIGHT_TOP, KINDS, OCCUPATION, WALL_SHARE
from orograph.mapping import RobotMapper
from orograph.mapping.cells import map_of, unknown_values
from orograph.mapping.door import laser_height_m
from orograph.mapping.mapper import EVERYWHERE
from orograph.mapping.reconstruction import Reconstructor
from orograph.mapping.rescaling_kernels import rescale_block
from orograph.mapping.seeing import Rays
from orograph.mapping.seeing_kernels import BINS, GROUND, RAISED, UNCLEAR, direction
from orograph.mapping.standing_kernels import standing_cells
from orograph.mapping.surface_kernels import FLAT, NEITHER, STEP
from orograph.messages import RANGE_UNIT_M
from orograph.registers import pack
from orograph.rules import SURFACE
from orograph.scenario import LaserSpec

GLRM = Grid((0.0, 0.0), 5.0, (8, 8))
EYE = (20.0, 20.0, 0.9)
BARRED, UNKNOWN = 254, 255


def mapper(rules=SURFACE) -> RobotMapper:
    return RobotMapper(GLRM, 80, 10, rules, 80.0)


def disc(reach_m: float = 14.0) -> np.ndarray:
    """Flat ground round the eye, dense enough for every cell."""
    x, y = np.meshgrid(np.arange(6.05, 34, 0.1), np.arange(6.05, 34, 0.1))
    near = np.hypot(x - EYE[0], y - EYE[1]) < reach_m
    return np.column_stack([x[near], y[near], np.zeros(near.sum())])


def wall(x: float, top_m: float) -> np.ndarray:
    """A face towards the eye, 4 m wide."""
    y, z = np.meshgrid(np.arange(18.05, 22, 0.1), np.arange(0.05, top_m, 0.1))
    return np.column_stack([np.full(y.size, x), y.ravel(), z.ravel()])


def before(points: np.ndarray, x: float) -> np.ndarray:
    """What of the ground a wall at x hides is not seen."""
    return points[~((points[:, 0] > x) & (np.abs(points[:, 1] - 20) < 0.15 * (points[:, 0] - 6)))]


def see(robot: RobotMapper, points: np.ndarray, k: int, eye=EYE) -> None:
    ranges_m = np.hypot(points[:, 0] - EYE[0], points[:, 1] - EYE[1]).clip(0.5)
    robot.step(points, ranges_m, eye, k * 400_000_000)


def at(robot: RobotMapper, x: float, y: float, name: str) -> float:
    layer = robot.evidence.by_name.get(name)
    return KINDS[name].blank if layer is None else float(layer[robot.hrm_grid.row_col(x, y)])


def test_a_wall_has_a_top_and_no_ground_and_bars_its_cell():
    robot = mapper()
    see(robot, np.vstack([before(disc(), 26.2), wall(26.2, 3.0)]), 0)
    assert at(robot, 26.2, 20.2, "height_top") == pytest.approx(2.95, abs=0.15)
    assert at(robot, 26.2, 20.2, "confidence_top") > 200
    assert (at(robot, 26.2, 20.2, "wall_share"), at(robot, 26.2, 20.2, "occupation")) == (1.0, 1.0)
    assert (at(robot, 26.2, 20.2, "confidence"), at(robot, 25.7, 20.2, "occupation")) == (0.0, 0.0)
    assert at(robot, 25.7, 20.2, "height") == 0.0, "the street before it stays flat"


def test_what_hangs_over_is_neither_ground_nor_obstacle():
    robot = mapper()
    bridge = wall(26.2, 0.2) + np.array([0, 0, 4.0])
    see(robot, disc(), 0)
    see(robot, np.vstack([disc(), bridge]), 1)
    assert (at(robot, 26.2, 20.2, "occupation"), at(robot, 26.2, 20.2, "height")) == (0.0, 0.0)
    assert at(robot, 26.2, 20.2, "free_share") == 1.0


def test_two_rings_on_a_far_wall_are_no_ground():
    robot = mapper()
    ring = wall(33.0, 0.25) + np.array([0, 0, 2.4])
    see(robot, np.vstack([disc(8.0), ring]), 0)
    assert at(robot, 33.0, 20.2, "confidence") == 0.0
    assert at(robot, 33.0, 20.2, "height_top") == pytest.approx(2.5, abs=0.11)


@pytest.mark.parametrize(("eye", "cleared"), [(EYE, True), ((20.0, 20.0, np.nan), False)])
def test_rays_that_pass_clear_what_has_gone_if_the_eye_is_known(eye, cleared):
    """Nothing is hit in the wall's cells any more: only what is seen behind tells."""
    robot, wide = mapper(), np.vstack([before(disc(), 26.2), wall(26.2, 3.0)])
    behind = before(wall(33.0, 3.0), 40)
    for k in range(4):
        see(robot, wide, k, eye)
    assert at(robot, 26.2, 20.2, "occupation") == 1.0
    for k in range(4, 10):
        see(robot, np.vstack([before(disc(), 25.7), behind]), k, eye)
    assert (at(robot, 26.2, 20.2, "wall_share") == 0.0) == cleared
    assert (at(robot, 26.2, 20.2, "confidence_top") == 0.0) == cleared


def test_planning_sees_at_once_what_long_was_free_and_forgets_it_when_it_left():
    robot, told = mapper(), np.zeros(GLRM.size, np.uint8)
    prior = unknown_values(GLRM.size)

    def code() -> int:
        return int(robot.planning_occupation(prior, told)[robot.hrm_grid.row_col(26.2, 20.2)])

    for k in range(8):
        see(robot, disc(), k)
    assert code() == 0
    see(robot, np.vstack([before(disc(), 26.2), wall(26.2, 1.5)]), 8)
    assert code() == BARRED and at(robot, 26.2, 20.2, "wall_share") == 0.0, "the slow map waits"
    for k in range(9, 12):
        see(robot, disc(), k)
    assert code() == 0


def range_image(directions: np.ndarray, car: bool) -> np.ndarray:
    """Flat ground 0.7 m below the eye, rays over the horizon without a return; a car 11.05 m to the east."""
    with np.errstate(divide="ignore"):
        ground_m = np.where(directions[..., 2] < -1e-3, -0.7 / directions[..., 2], np.inf)
        car_m = np.where(directions[..., 0] > 0.1, 11.05 / directions[..., 0], np.inf)
    beside, over = np.abs(car_m * directions[..., 1]) < 1.0, 0.7 + car_m * directions[..., 2] < 1.6
    ranges_m = np.where(car & beside & over, np.minimum(car_m, ground_m), ground_m)
    return np.where(ranges_m < 60, ranges_m / RANGE_UNIT_M, 0).astype(np.uint16)


def test_rays_without_a_return_pass_what_has_left():
    """Two rings meet the car: the lower one then ends on the ground below, the upper one nowhere."""
    robot, directions = mapper(), ray_directions(LaserSpec(rings=8, columns=360))
    for k in range(12):
        robot.step_scan(range_image(directions, k < 2), directions, np.eye(3), (20.4, 20.0, 0.7), k * 400_000_000)
        assert k >= 2 or at(robot, 31.2, 20.2, "wall_share") == 1.0
    assert at(robot, 31.2, 20.2, "wall_share") == 0.0


def test_the_ranges_tell_the_lasers_height():
    given, told = mapper(), mapper()
    points = np.vstack([before(disc(), 25.7), wall(25.7, 3.0)])
    for robot, eye in ((given, EYE), (told, EYE[:2])):
        robot.step(points, np.linalg.norm(points - EYE, axis=1), eye, 0)
    assert told.evidence.equals(given.evidence)
    for cloud in (disc(), points):
        ranges_m = np.linalg.norm(cloud - EYE, axis=1)
        assert laser_height_m(cloud, ranges_m, *EYE[:2]) == pytest.approx(EYE[2], abs=1e-6)
        assert np.isnan(laser_height_m(cloud, ranges_m + 1.0, *EYE[:2])), "no height fits these"


def test_a_block_says_what_of_it_stands_and_what_is_free():
    fine = unknown_values(100)
    fine[:, [HEIGHT, CONFIDENCE, OCCUPATION, FREE_SHARE]] = 2.0, 100.0, 0.25, 1.0
    fine[:10] = unknown_values(10)
    fine[:10, [HEIGHT_TOP, CONFIDENCE_TOP, WALL_SHARE, OCCUPATION]] = 7.0, 90.0, 1.0, 1.0
    fine[3, HEIGHT_TOP] = 8.5
    coarse = unknown_values(1)[0]
    rescale_block(fine, np.zeros(100, np.uint32), 10, 10, 0, coarse)
    assert coarse[[HEIGHT, HEIGHT_TOP, CONFIDENCE_TOP]].tolist() == [2.0, 8.5, 90.0]
    assert coarse[[CONFIDENCE, WALL_SHARE, FREE_SHARE, OCCUPATION]] == pytest.approx([90.0, 0.1, 0.9, 0.25])
    fine[15:, OCCUPATION] = np.nan
    rescale_block(fine, np.zeros(100, np.uint32), 10, 10, 0, coarse)
    assert coarse[OCCUPATION] == pytest.approx(0.25 * 5 / 90), "what is flat without a slope is free"
    fine[50:] = unknown_values(50)
    rescale_block(fine, np.zeros(100, np.uint32), 10, 10, 0, coarse)
    assert coarse[OCCUPATION] == 1.0, "40 of 100 free, and a wall: a house"


def test_a_row_comes_back_unchanged_and_its_walls_wait_for_a_first_look():
    rng, robot = np.random.default_rng(3), mapper()
    values = rng.uniform([-9, -1, -1, 0, 1, 1, 1, 0.1, 0.1], [9, 1, 1, 1, 255, 20, 255, 0.5, 0.5], (64, 9))
    row = pack(np.arange(64), rng.integers(0, 9000, 64), values.astype(np.float32))
    robot.adopt(row, fuse=True)
    np.testing.assert_array_equal(robot.registers(), row)
    for eye in ((12.0, 12.0, 1.0), (30.0, 25.0, 1.0)):
        robot.step(np.zeros((0, 3)), np.zeros(0), eye, 10_000_000_000)
        np.testing.assert_array_equal(robot.registers(), row)


def test_what_was_seen_flat_is_free_over_a_prior_that_has_a_house_there():
    robot, house = mapper(), unknown_values(GLRM.size)
    house[:, [HEIGHT, CONFIDENCE, OCCUPATION, WALL_SHARE]] = 0.0, 32.0, 1.0, 1.0
    robot.step(np.array([[26.2, 20.2, 0.0]]), np.array([6.3]), EYE, 0)
    occupation = robot.hrm(map_of(house, GLRM)).occupation
    assert np.argwhere(occupation < 1.0).tolist() == [list(robot.hrm_grid.row_col(26.2, 20.2))]


def test_rules_of_one_surface_know_nothing_of_what_stands():
    robot = mapper(GATED)
    see(robot, np.vstack([disc(), wall(26.2, 3.0)]), 0)
    assert set(robot.evidence.by_name) & {"height_top", "wall_share", "free_share"} == set()


GRID = Grid((0.0, 0.0), 0.5, (6, 6))
point = st.tuples(st.floats(0, 2.999), st.floats(0, 2.999), st.sampled_from([0.0, 0.1, 0.25, 0.35, 1.2, 1.7, 3.0, 6.0]),
                  st.integers(0, 2))  # fmt: skip


@settings(max_examples=200, deadline=None)
@given(st.lists(point, min_size=1, max_size=60), st.floats(1, 75), st.booleans())
def test_a_scan_is_parted_as_the_oracle_parts_it(points, distance_m, sure):
    xyz, raised = np.array([p[:3] for p in points]), np.array([p[3] for p in points], np.uint8)
    held = unknown_values(GRID.size)
    held[:, [HEIGHT, CONFIDENCE]] = -0.4, 64.0 if sure else 16.0
    maker = Reconstructor(GRID.size, 80.0, SURFACE.real(0.3))
    cells, values, kinds = maker.aux(xyz, np.full(len(xyz), distance_m), GRID, held, raised)
    inside = defaultdict(list)
    for i, (x, y, _) in enumerate(xyz.tolist()):
        inside[int(y // 0.5) * 6 + int(x // 0.5)].append(i)
    assert sorted(cells.tolist()) == sorted(inside)
    f = distance_factor(np.float64(distance_m), 80.0)
    for cell, value, kind in zip(cells.tolist(), values, kinds.tolist(), strict=True):
        its = inside[cell]
        ground = np.float64(np.float32(-0.4)) if sure else None
        wanted = parted(xyz[its, 2], [f] * len(its), raised[its], ground, 0.3, 1.5)
        assert {FLAT: "flat", STEP: "step", NEITHER: "neither"}[kind] == wanted[0]
        for found, want in ((value[HEIGHT], wanted[1]), (value[HEIGHT_TOP], wanted[2])):
            assert np.isnan(found) if want is None else found == pytest.approx(want, abs=1e-6)
        assert value[CONFIDENCE_TOP] == pytest.approx(wanted[3], rel=1e-5)
        assert (value[CONFIDENCE] > 0) == (wanted[1] is not None)


@pytest.mark.parametrize("rings", ["lowest first", "uppermost first", "in any order"])
def test_rays_are_sorted_the_same_in_whatever_order_a_laser_gives_its_rings(rings):
    rng = np.random.default_rng(4)
    elevation = np.sort(np.round(rng.uniform(-0.4, 0.2, (40, 300)), 2), axis=0)  # many alike
    azimuth = np.broadcast_to(rng.uniform(-3, 3, 300), elevation.shape)
    reach_m = 10.0
    points = np.stack([reach_m * np.cos(azimuth), reach_m * np.sin(azimuth), reach_m * elevation], axis=-1)
    points = (points[::-1] if rings == "uppermost first" else points).reshape(-1, 3)
    points = rng.permutation(points) if rings == "in any order" else points
    n, rays = len(points), Rays()
    rays.sort(np.ascontiguousarray(points.T), np.zeros(3), 0.5, 2.0)
    up = points[:, 2] / np.sqrt(points[:, 0] * points[:, 0] + points[:, 1] * points[:, 1])
    bins = np.array([int(direction(x, y) * BINS / 4) % BINS for x, y, _ in points.tolist()])
    order = rays._order
    assert order.tolist() == np.lexsort((np.arange(n), up, bins)).tolist()
    assert rays._first[BINS] == n and np.array_equal(rays._rise, up[order])


@settings(max_examples=100, deadline=None)
@given(st.integers(0, 2**31))
def test_the_rays_through_a_cell_are_those_of_plain_geometry(seed):
    """Sure of what passes near the centre and of what passes wide; in between a direction's width decides."""
    rng = np.random.default_rng(seed)
    eye, n = np.array([1.0, 2.0, 1.0]), 400
    points = eye + rng.uniform(-20, 20, (n, 3)) * [1, 1, 0.1]
    rays, grid = Rays(), Grid((-20.0, -20.0), 0.5, (80, 80))
    rays.sort(np.ascontiguousarray(points.T), eye, 0.5)
    cells = rng.integers(0, grid.size, 30)
    passes = rays.passes(eye, grid, cells, np.full(30, 1.1, np.float32), EVERYWHERE)
    centres = np.column_stack([(cells % 80 + 0.5) * 0.5 - 20, (cells // 80 + 0.5) * 0.5 - 20])
    for (x, y), found in zip((centres - eye[:2]).tolist(), passes.tolist(), strict=True):
        away = np.hypot(x, y)
        if away < 1.5:
            continue
        flat = points[:, :2] - eye[:2]
        reach = np.hypot(*flat.T)
        beside = np.abs(flat[:, 0] * y - flat[:, 1] * x) / reach
        ahead, on = flat @ [x, y] > 0, reach >= away + 0.5
        below = eye[2] + (points[:, 2] - eye[2]) / reach * away < 1.1
        sure, maybe = (int((ahead & on & below & (beside < m)).sum()) for m in (0.13, 0.17 + 0.0075 * away))
        assert sure <= found <= maybe


def test_what_is_raised_lies_upright_or_higher_than_a_slope_leads():
    eye = np.array([0.0, 0.0, 1.0])
    ground = [(2.0, 0.0), (4.0, 0.0), (8.0, 0.02)]
    face, roof, hill = [(10.0, 1.0), (10.05, 1.5), (10.0, 2.0)], [(20.0, 4.5)], [(9.0, 0.5)]
    for extra, wanted in (
        (face, [RAISED] * 3),
        (hill, [GROUND]),
        (face + roof, [RAISED] * 4),
        ([(22.0, 2.5)], [UNCLEAR]),
        ([(24.0, 0.1)], [UNCLEAR]),
        ([(22.0, 0.1)], [GROUND]),
    ):
        rays, points = Rays(), np.array([(d, 0.001, z) for d, z in ground + extra])
        rays.sort(np.ascontiguousarray(points.T), eye, 0.5)
        assert rays.raised(len(points), 0.6).tolist() == [GROUND] * 3 + wanted


@settings(max_examples=100, deadline=None)
@given(st.integers(0, 2**32 - 1), st.integers(1, 700))
def test_what_stands_is_listed_but_for_what_was_hit(seed, cells):
    random = np.random.default_rng(seed)
    standing = np.where(random.random(cells) < 0.1, random.normal(0, 2, cells), 0).astype(np.float32)
    hit = np.flatnonzero(random.random(cells) < 0.2)
    held = standing.copy()
    wanted = [c for c in range(cells) if held[c] > 0 and c not in set(hit.tolist())]
    assert standing_cells(standing, hit).tolist() == wanted
    assert np.array_equal(standing, held)
