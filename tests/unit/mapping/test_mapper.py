"""RobotMapper: whole runs with rolling against the oracle, the list, acknowledgement, adoption, planning."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from made_up.cells import GATED, wide
from oracles import mapping_oracle as oracle
from orograph.geometry import ray_directions, rotation
from orograph.grid import Grid
from orograph.layers import BASIC_LAYERS, OCCUPATION_ONE, UNKNOWN_OCCUPATION, CellMap
from orograph.mapping import RobotMapper, fuse, reconstruct, rescale
from orograph.mapping.cells import map_of, values_of
from orograph.mapping.rescaling import expand
from orograph.messages import REGISTER, UPDATE, Packed
from orograph.registers import pack
from orograph.rules import PAPER
from orograph.scenario import LaserSpec
from orograph.stages import StageRecorder

GLRM = Grid((0.0, 0.0), 5.0, (6, 7))
SECOND_NS = 1_000_000_000
NEAR_M = 1e-9
"""The nearest range that counts, where f(D) is 1."""


def mapper(**changes) -> RobotMapper:
    """Windows of 3 x 3 GLRM cells of 4 x 4 HRM cells."""
    return RobotMapper(
        **{
            "glrm_grid": GLRM,
            "hrm_cells": 12,
            "per_glrm_cell": 4,
            "rules": GATED,
            "range_max_m": 80.0,
            "range_min_m": 0.0,
        }
        | changes
    )


def patch(x_m: float, y_m: float, z_m: float = 1.0, slope: float = 0.0) -> np.ndarray:
    """16 points that fill the HRM cell (1.25 m) from (x, y) on."""
    steps = 0.15 + 0.3125 * np.arange(4)
    x, y = (a.reshape(-1) for a in np.meshgrid(steps, steps))
    return np.column_stack([x_m + x, y_m + y, z_m + slope * (x - x.mean())])


def see(
    robot: RobotMapper, points: np.ndarray, at=(12.0, 12.0), stamp_ns: int = SECOND_NS, held: Packed | None = None
) -> Packed:
    return robot.step(points, np.full(len(points), NEAR_M), at, stamp_ns, held)


def held_of(records: Packed) -> Packed:
    """What a receiver of these records alone holds."""
    held = np.zeros(GLRM.size, UPDATE)
    held[records["cell"]] = records
    return held


def rows(records: Packed, epoch: int = 1) -> Packed:
    row = np.zeros(len(records), REGISTER)
    row["epoch"] = epoch
    for name in records.dtype.names:
        row[name] = records[name]
    return row


def test_a_scan_gives_a_register_of_its_cells_own_evidence():
    records = see(mapper(), patch(11.25, 12.5))
    assert len(records) == 1
    record = records[0]
    assert (record["cell"], record["seq"], record["tick"]) == (2 * 7 + 2, 0, 1000)
    assert (record["height"], record["gradient_x"], record["occupation"]) == (1000, 0, 0)
    assert record["confidence"] == round(255 / 16)


def test_the_list_names_what_moved_from_what_the_receiver_holds():
    robot = mapper(rules=PAPER)
    first = see(robot, patch(11.25, 12.5))
    assert len(see(robot, patch(11.25, 12.5))) == 1, "nobody holds it: still worth sending"
    held = held_of(first)
    assert len(see(robot, patch(11.25, 12.5), held=held)) == 0
    assert len(see(robot, patch(11.25, 12.5), held=rows(held))) == 0, "REGISTERs do as well"
    assert len(see(robot, patch(12.5, 12.5), held=held)) == 0, "from 16 to 32, which is 16 and not more"
    assert len(see(robot, patch(13.75, 12.5), held=held)) == 1
    assert see(robot, patch(6.25, 6.25), held=held).size == 1, "first sight elsewhere"


@pytest.mark.parametrize(("field", "step", "listed"), [
    ("height", 100, False), ("height", 101, True), ("height", -101, True), ("occupation", 25, False),
    ("occupation", 26, True), ("occupation", -26, True), ("confidence", 16, False), ("confidence", 17, True),
    ("confidence", -17, True), ("gradient_x", 900, False), ("tick", 900, False),
])  # fmt: skip
def test_each_threshold(field, step, listed):
    """0.1 of occupation is 25.4 / 254."""
    robot = mapper(rules=PAPER)
    for _ in range(3):
        see(robot, patch(11.25, 12.5, slope=0.15))
    held = see(robot, patch(11.25, 12.5, slope=0.15))
    held[field] = held[field].astype(np.int64) + step
    probe = mapper(rules=PAPER)
    for _ in range(3):
        see(probe, patch(11.25, 12.5, slope=0.15))
    assert (len(see(probe, patch(11.25, 12.5, slope=0.15), held=held_of(held))) == 1) == listed


def test_an_occupation_that_becomes_known_is_listed():
    robot = mapper()
    first = see(robot, patch(11.25, 12.5)[:2])
    assert first["occupation"].tolist() == [UNKNOWN_OCCUPATION]
    first["confidence"] = 15
    assert see(robot, patch(11.25, 12.5), held=held_of(first)).size == 1


def test_points_dropped_are_counted_by_reason():
    robot = mapper()
    points = np.vstack([patch(11.25, 12.5), [[np.nan, 0, 0], [11.0, 12.0, 0], [99.0, 0, 0]]])
    points = np.vstack([points, [[12.0, 12.0, 0.5]] * 3])
    robot.step(points, np.array([NEAR_M] * 17 + [81.0, 1.0, 0.0, -1.0, -1e9]), (12.0, 12.0), 0)
    assert robot.dropped == {
        "not_finite": 1, "beyond_range": 1, "outside_grid": 1, "below_range": 3, "outside_map": 0,
    }  # fmt: skip


def test_the_own_body_and_rays_without_return_are_no_surface():
    robot = RobotMapper(GLRM, 12, 4, GATED, 80.0)
    listed = see(robot, patch(11.25, 12.5))
    assert not len(listed) and not robot.evidence.known.any()
    assert robot.dropped["below_range"] == 16


def test_what_lies_beyond_the_global_map_is_counted():
    robot = mapper()
    see(robot, np.vstack([patch(-3.75, 2.5), patch(2.5, 2.5)]), at=(1.0, 1.0))
    assert robot.dropped["outside_map"] == 16 and robot.dropped["outside_grid"] == 0


def test_a_clock_that_restarts_is_counted_and_the_map_goes_on():
    robot = mapper()
    for stamp_s in (0, 300, 0):
        see(robot, patch(11.25, 12.5, z_m=float(stamp_s == 0)), stamp_ns=stamp_s * SECOND_NS)
    assert robot.clock_restarts == 1
    assert robot.registers()["tick"].tolist() == [600_000]


def test_numbers_that_cannot_be_are_refused_in_words():
    for changes in ({"range_max_m": 0.0}, {"range_max_m": np.nan}, {"slope_max": 0.0}):
        with pytest.raises(ValueError, match="expected a finite number above 0"):
            mapper(**changes)


def test_the_window_keeps_the_robot_within_one_glrm_cell_of_its_centre_and_does_not_tremble():
    robot = mapper()
    moves, last = 0, None
    for step, (x, y) in enumerate([(12.0 + 0.9 * k, 14.0 - 0.7 * k) for k in range(12)] * 2):
        wobble = 0.8 * (-1) ** step
        robot.roll_to((x + wobble, y + wobble))
        x0, y0, x1, y1 = robot.hrm_grid.extent_m
        assert abs((x0 + x1) / 2 - x - wobble) <= 5.0 and abs((y0 + y1) / 2 - y - wobble) <= 5.0
        assert x0 % 5 == 0 and y0 % 5 == 0
        moves += (x0, y0) != last
        last = x0, y0
    assert moves <= 11


def test_cells_outside_the_glrm_are_mapped_but_never_reported():
    robot = mapper()
    records = see(robot, np.vstack([patch(-2.5, 1.25), patch(1.25, -2.5), patch(1.25, 1.25)]), at=(1.0, 1.0))
    assert records["cell"].tolist() == [0] and robot.registers().size == 1
    assert robot.evidence.known.sum() == 3


def test_what_rolls_out_and_in_again_is_the_same_register():
    """Coarse to fine to coarse without new points, many times over, changes nothing, whatever the rules."""
    robot = mapper()
    rng = np.random.default_rng(5)
    for k in range(12):
        see(robot, rng.uniform([5, 5, -3], [20, 20, 3], (200, 3)), stamp_ns=k * SECOND_NS)
    before = robot.registers()
    assert len(before) == 9
    for _ in range(5):
        for at in ((33.0, 28.0), (1.0, 1.0), (12.0, 12.0)):
            see(robot, np.zeros((0, 3)), at=at, stamp_ns=99 * SECOND_NS)
            np.testing.assert_array_equal(robot.registers(), before)
    edge = see(robot, patch(11.25, 12.5), stamp_ns=100 * SECOND_NS)
    assert set(robot.registers()["cell"]) == set(before["cell"]) >= set(edge["cell"])
    same = robot.registers()["cell"] != 2 * 7 + 2
    np.testing.assert_array_equal(robot.registers()[same], before[same])


def test_the_llrm_is_the_window_on_glrm_cells():
    given = np.arange(42, dtype=np.float32).reshape(6, 7) % 3, np.ones((6, 7), np.float32)
    robot = mapper(given=given)
    see(robot, np.vstack([patch(11.25, 12.5), patch(6.25, 16.25)]))
    llrm = robot.llrm()
    assert llrm.grid == Grid((5.0, 5.0), 5.0, (3, 3))
    assert llrm.equals(rescale(robot.evidence, 4))
    np.testing.assert_array_equal(llrm.gps_quality, given[0][1:4, 1:4])
    cells = robot.registers()["cell"]
    assert cells.tolist() == [2 * 7 + 2, 3 * 7 + 1]
    assert llrm.known[1, 1] and llrm.known[2, 0] and llrm.known.sum() == 2


def test_a_row_of_an_earlier_life_is_fused_with_what_was_seen_since():
    earlier = mapper()
    for k in range(8):
        see(earlier, np.vstack([patch(10 + 1.25 * k, 12.5) for k in range(4)] + [patch(27.5, 27.5)]), at=(17.0, 17.0))
    row = earlier.registers()
    robot = mapper(rules=PAPER)
    see(robot, patch(11.25, 12.5), stamp_ns=2 * SECOND_NS)
    own = robot.registers()
    robot.adopt(rows(row), fuse=True)
    after = {int(r["cell"]): r for r in robot.registers()}
    assert sorted(after) == row["cell"].tolist()
    for record in row:
        assert after[int(record["cell"])]["confidence"] >= record["confidence"], "invariant 10"
    assert (row["confidence"][0], own["confidence"][0]) == (64, 16)
    assert after[16]["confidence"] == 76, "15 fine cells of 64, and one where 64 + 255 is 255"
    assert after[16]["tick"] == 2000


def test_a_row_of_this_life_fills_gaps_only():
    robot = mapper()
    see(robot, patch(11.25, 12.5))
    own = robot.registers()
    row = pack(np.array([16, 17, 40]), 7, wide([[3, 0, 0, 0, 40], [4, 0, np.nan, np.nan, 1], [5, 0, 0, 1, 255]]))
    robot.adopt(rows(row), fuse=False)
    registers = robot.registers()
    np.testing.assert_array_equal(registers[:1], own)
    np.testing.assert_array_equal(registers[1:], row[1:])
    assert robot.evidence.height[4:8, 8:12].tolist() == [[4.0] * 4] * 4


@pytest.mark.parametrize("fused", [True, False])
def test_a_row_adopted_before_the_first_scan_comes_back_unchanged(fused):
    rng = np.random.default_rng(11)
    cells = np.arange(42)
    values = wide(rng.uniform([-9, -3, -3, 0, 1], [900, 3, 3, 1, 255], (42, 5)))
    row = pack(cells, rng.integers(0, 9000, 42), values)
    robot = mapper()
    robot.adopt(rows(row), fuse=fused)
    np.testing.assert_array_equal(robot.registers(), row)
    for at in ((12.0, 12.0), (30.0, 25.0)):
        see(robot, np.zeros((0, 3)), at=at)
        np.testing.assert_array_equal(robot.registers(), row)


def prior_map(rng: np.random.Generator) -> CellMap:
    values = np.column_stack(
        [rng.uniform(0, 4, 42), *rng.uniform(-0.3, 0.3, (2, 42)), rng.uniform(0, 1, 42), rng.uniform(1, 60, 42)]
    )
    values[::5, 1:4] = np.nan
    values[::7] = np.nan, np.nan, np.nan, np.nan, 0.0
    return map_of(wide(values), GLRM)


@pytest.mark.parametrize("at", [(12.0, 12.0), (1.0, 29.0)])
def test_the_hrm_is_the_evidence_over_the_prior_under_it(at):
    rng = np.random.default_rng(3)
    prior, robot = prior_map(rng), mapper()
    see(robot, rng.uniform([at[0] - 8, at[1] - 8, 0], [at[0] + 8, at[1] + 8, 3], (300, 3)), at=at)
    hrm, evidence = robot.hrm(prior), robot.evidence
    row0, col0 = round(hrm.grid.origin_m[1] / 5), round(hrm.grid.origin_m[0] / 5)
    for row, col in np.ndindex(12, 12):
        block = row0 + row // 4, col0 + col // 4
        inside = 0 <= block[0] < 6 and 0 <= block[1] < 7
        under = tuple(
            float(getattr(prior, n)[block]) if inside else (np.nan if n != "confidence" else 0.0) for n in BASIC_LAYERS
        )
        own = tuple(float(getattr(evidence, n)[row, col]) for n in BASIC_LAYERS)
        found = [getattr(hrm, n)[row, col] for n in BASIC_LAYERS]
        np.testing.assert_allclose(found, oracle.fuse(under, own, oracle.Rules(60.0, 1.0)), rtol=1e-5, atol=1e-6)


def codes_of(cell_map: CellMap) -> np.ndarray:
    """Occupation (cells,) in 1/254, halves up, 255 unknown."""
    occupation = cell_map.occupation.reshape(-1).astype(np.float64)
    codes = np.floor(np.nan_to_num(occupation) * OCCUPATION_ONE + 0.5)
    return np.where(np.isnan(occupation), UNKNOWN_OCCUPATION, codes).astype(np.uint8)


@pytest.mark.parametrize("at", [(12.0, 12.0), (1.0, 29.0)])
def test_planning_sees_the_hrms_occupation_and_elsewhere_what_the_robot_was_told(at):
    rng = np.random.default_rng(4)
    prior, told, robot = prior_map(rng), prior_map(rng), mapper()
    see(robot, rng.uniform([at[0] - 8, at[1] - 8, 0], [at[0] + 8, at[1] + 8, 3], (150, 3)), at=at)
    codes = robot.planning_occupation(values_of(prior), codes_of(told))
    assert 0 < robot.evidence.known.sum() < 144
    np.testing.assert_array_equal(codes, planned(robot, prior, told))


def planned(robot: RobotMapper, prior: CellMap, told: CellMap) -> np.ndarray:
    """Evidence over the prior where there is any, elsewhere what was told, all of it computed afresh."""
    known = robot.evidence.known
    occupation = np.where(known, robot.hrm(prior).occupation, robot.hrm(told).occupation).astype(np.float64)
    codes = np.floor(np.nan_to_num(occupation) * OCCUPATION_ONE + 0.5)
    return np.where(np.isnan(occupation), UNKNOWN_OCCUPATION, codes).astype(np.uint8)


@pytest.mark.parametrize("seed", range(4))
def test_planning_hears_of_every_change_though_only_what_changed_is_computed(seed):
    """Scans of a few cells, rolling there and back, adoption, other priors and other news of few different values."""
    rng = np.random.default_rng(seed)
    maps = [prior_map(rng) for _ in range(6)]
    for told_map in maps[3:]:
        np.round(told_map.occupation, out=told_map.occupation)
    priors, news = [values_of(m) for m in maps[:3]], [codes_of(m) for m in maps[3:]]
    robot, at, changes, last = mapper(), np.array([17.0, 15.0]), 0, None
    for k in range(40):
        at = np.clip(at + rng.uniform(-6, 6, 2), 0, 34) if k % 4 in (0, 3) else at
        see(robot, rng.uniform([*at - 1.5, 0], [*at + 1.5, 3], (20, 3)), at, k * SECOND_NS)
        if k % 7 == 4:
            robot.adopt(rows(pack(np.arange(42), 1, values_of(prior_map(rng))))[::5], fuse=k % 2 == 0)
        prior, told = k // 14, k // 4 % 3
        if k % 5 == 2:
            continue  # nobody asks, and the window may move before the next one does
        codes = robot.planning_occupation(priors[prior], news[told])
        np.testing.assert_array_equal(codes, planned(robot, maps[prior], maps[3 + told]), err_msg=f"{seed=} {k=}")
        changes += last is not None and not np.array_equal(codes, last)
        last = codes
    assert changes > 25


def test_a_range_image_is_mapped_as_its_points():
    laser = LaserSpec(rings=8, columns=64)
    image = np.random.default_rng(2).integers(0, 6000, (8, 64)).astype("<u2")
    R, at = rotation(0.1, -0.2, 2.0), np.array([12.0, 13.0, 1.0])
    recorder = StageRecorder(iter(range(1000)).__next__)
    one, two = mapper(stage=recorder), mapper()
    directions = ray_directions(laser)
    points, ranges_m = [], []
    for distance, direction in zip(image.reshape(-1), directions.reshape(-1, 3), strict=True):
        if distance:
            ranges_m.append(distance * 0.002)
            points.append(at + R @ (direction.astype(np.float64) * distance * 0.002))
    two.step(np.array(points), np.array(ranges_m), at[:2], SECOND_NS)
    records = one.step_scan(image, directions, R, at, SECOND_NS)
    assert len(records) == 9
    np.testing.assert_array_equal(records, two.registers())
    assert sorted(recorder.durations_ns) == sorted(
        ["points", "height", "gradients", "confidence", "occupation", "fuse_hrm", "rescale"]
    )


def test_one_scan_is_reconstruct_then_fuse():
    rng = np.random.default_rng(8)
    robot = mapper(rules=PAPER)
    expected = CellMap.unknown(Grid((5.0, 5.0), 1.25, (12, 12)))
    for _ in range(4):
        points = rng.uniform([5, 5, 0], [20, 20, 0.3], (300, 3))
        aux = reconstruct(points, np.full(300, 9.0), expected.grid, 80.0)
        expected = fuse(expected, aux, PAPER)
        robot.step(points, np.full(300, 9.0), (12.0, 12.0), 0)
    assert robot.evidence.equals(expected)
    assert expand(robot.llrm(), 4).grid == expected.grid


step = st.tuples(st.floats(-2, 36), st.floats(-2, 31), st.integers(0, 90_000), st.integers(0, 2**31))


@settings(max_examples=40, deadline=None)
@given(st.lists(step, min_size=1, max_size=6), st.sampled_from([3, 4]), st.booleans())
def test_a_whole_run_equals_the_oracle(steps, blocks, paper):
    rules = (PAPER, oracle.Rules()) if paper else (GATED, oracle.Rules(60.0, 1.0))
    robot = mapper(hrm_cells=4 * blocks, rules=rules[0])
    slow = oracle.Robot(GLRM.shape, 5.0, blocks, 4, rules[1], 80.0)
    tick = 0
    for x, y, after_ms, seed in steps:
        rng, tick = np.random.default_rng(seed), tick + after_ms
        points = rng.uniform([x - 10, y - 10, 0], [x + 10, y + 10, 2.5], (60, 3))
        points = np.vstack(
            [points, patch(float(np.floor(x)), float(np.floor(y)), slope=float(rng.choice([0, 0.1, 1.5])))]
        )
        ranges_m = rng.uniform(1e-6, 82, len(points))
        touched = slow.scan(points, ranges_m, x, y, tick)
        listed = robot.step(points, ranges_m, (x, y), tick * 1_000_000)
        assert {divmod(int(c), 7) for c in listed["cell"]} == touched, "nothing is acknowledged, so all that is touched"
    registers = robot.registers()
    assert {divmod(int(c), 7) for c in registers["cell"]} == set(slow.coarse)
    for record in registers:
        cell, newest = slow.coarse[divmod(int(record["cell"]), 7)]
        wanted = pack(record["cell"][None], newest, wide([cell]))[0]
        assert record["tick"] == newest
        for name in ("height", "gradient_x", "gradient_y", "occupation", "confidence"):
            assert abs(int(record[name]) - int(wanted[name])) <= 1, (name, record, wanted)
    rows_cols = np.argwhere(robot.evidence.known)
    row0, col0 = slow.window
    assert {(int(r) + 4 * row0, int(c) + 4 * col0) for r, c in rows_cols} == set(slow.fine)
