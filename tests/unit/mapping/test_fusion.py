"""fuse and rescale: hand-computed cases, and the plain-Python oracle."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from made_up.cells import GATED, wide
from oracles import mapping_oracle as oracle
from orograph.grid import Grid
from orograph.layers import MAPPED_LAYERS, CellMap
from orograph.mapping import fuse, rescale
from orograph.mapping.cells import map_of, values_of
from orograph.mapping.fusion_kernels import fuse_cells
from orograph.mapping.rescaling import expand
from orograph.rules import PAPER, Rules

NAN = math.nan


def one(*cell: float) -> CellMap:
    """A map of one cell (height, gradient_x, gradient_y, occupation, confidence)."""
    return map_of(wide([cell]), Grid((0.0, 0.0), 1.0, (1, 1)))


def fused(old, new, rules=PAPER, slope_max=0.3):
    return tuple(values_of(fuse(one(*old), one(*new), rules, slope_max))[0, :5].tolist())


def test_similar_cells_are_averaged_by_confidence_and_their_confidence_adds():
    height, gx, gy, occupation, confidence = fused((1.0, 0.0, 0.1, 0.9, 30), (2.0, 0.1, 0.1, 0.9, 90))
    assert (height, confidence) == (1.75, 120.0)
    assert (gx, gy) == pytest.approx((0.075, 0.1))
    assert occupation == pytest.approx(math.hypot(0.075, 0.1) / 0.3)


def test_at_map_level_occupation_is_fused_like_height():
    assert fused((1.0, 0.0, 0.0, 0.2, 50), (1.0, 0.0, 0.0, 0.6, 150), slope_max=None)[3] == pytest.approx(0.5)
    assert fused((1.0, 0.0, 0.0, NAN, 50), (1.0, 0.0, 0.0, 0.6, 150), slope_max=None)[3] == pytest.approx(0.6)


def test_confidence_ends_at_255():
    assert fused((1.0, 0.0, 0.0, 0.0, 200), (1.0, 0.0, 0.0, 0.0, 200))[4] == 255.0


def test_a_cell_without_confidence_gives_way():
    cell, nothing = (1.0, 0.5, NAN, NAN, 3.0), (NAN, NAN, NAN, NAN, 0.0)
    for pair in ((cell, nothing), (nothing, cell)):
        np.testing.assert_array_equal(fused(*pair), np.array(cell, np.float32))
    assert np.isnan(fused(nothing, nothing)[:4]).all() and fused(nothing, nothing)[4] == 0


def test_an_unknown_gradient_counts_as_similar_and_a_known_one_is_kept():
    result = fused((1.0, NAN, 0.1, NAN, 50), (3.0, 0.2, NAN, NAN, 50))
    assert result == pytest.approx((2.0, 0.2, 0.1, math.hypot(0.2, 0.1) / 0.3, 100.0))


@pytest.mark.parametrize(("old_deg", "new_deg", "similar"), [
    (0, 9.99, True), (0, 10.01, False), (0, -9.99, True), (80, 89.9, True), (80, 69.9, False),
    (-5.0, 4.99, True), (-5.0, 5.01, False), (-89, 89, False), (60, -60, False),
])  # fmt: skip
def test_similarity_is_ten_degrees_between_slopes(old_deg, new_deg, similar):
    a, b = math.tan(math.radians(old_deg)), math.tan(math.radians(new_deg))
    for layer in (1, 2):
        old, new = [0.0, 0.0, 0.0, 0.0, 60.0], [0.0, 0.0, 0.0, 0.0, 50.0]
        old[layer], new[layer] = a, b
        assert (fused(old, new)[4] == 110.0) == similar


def test_the_height_gate_is_in_the_default_rules_only():
    near, far = (0.0, 0.0, 0.0, 0.0, 60.0), (1.0625, 0.0, 0.0, 0.0, 50.0)
    assert fused(near, far, PAPER)[4] == 110.0
    assert fused(near, far, GATED)[4] == 60.0
    assert fused(near, (1.0, 0.0, 0.0, 0.0, 50.0), GATED)[4] == 110.0


@pytest.mark.parametrize(("c_old", "c_new", "newer"), [
    (100, 60, False), (60, 100, True),  # clear difference: the higher
    (200, 169, True), (128, 128, True), (159, 128, True), (160, 128, False),  # both high: changed, unless 32 apart
    (127, 126, False), (126, 127, True), (50, 50, True), (130, 127, False),  # otherwise the higher, the new on a tie
])  # fmt: skip
def test_different_cells_one_is_taken_whole(c_old, c_new, newer):
    old, new = (0.0, 0.0, 0.0, 0.25, c_old), (9.0, 1.0, 0.0, 1.0, c_new)
    assert fused(old, new) == (new if newer else old)


def test_equation_12_as_printed_asks_the_new_confidence_only():
    printed = Rules(printed_equation_12=True)
    old, new = (0.0, 0.0, 0.0, 0.25, 200.0), (9.0, 1.0, 0.0, 1.0, 180.0)
    assert fused(old, new, PAPER) == new
    assert fused(old, new, printed) == old


def test_given_layers_of_a_fused_map_are_the_old_ones():
    grid = Grid((0.0, 0.0), 1.0, (1, 1))
    given_old = np.full((1, 1), 2, np.float32), np.zeros((1, 1), np.float32)
    old = map_of(wide([[0, 0, 0, 0, 9]]), grid, given_old)
    result = fuse(old, one(1, 0, 0, 0, 9), PAPER)
    assert result.gps_quality[0, 0] == 2 and result.communications[0, 0] == 0


@pytest.mark.parametrize(("held_tick", "new_tick", "height"), [(0, 60_000, 0.8), (60_000, 0, 0.2), (7, 7, 0.5)])
def test_the_older_cell_decays_by_half_in_a_half_life(held_tick, new_tick, height):
    """0 m and 1 m of equal confidence, where the older one keeps 80 / 4 = 20 after two half-lives."""
    rules = Rules(half_life_s=30.0, height_gate_m=5.0)
    values = wide([[0.0, 0.0, 0.0, 0.0, 80.0]])
    ticks, cells = np.array([held_tick], np.uint32), np.array([0])
    new = wide([[1.0, 0.0, 0.0, 0.0, 80.0]])
    fuse_cells(values, ticks, cells, new, np.array([new_tick], np.uint32), rules.real(0.3))
    assert values[0, 0] == pytest.approx(height)
    assert values[0, 4] == pytest.approx(100 if height != 0.5 else 160)
    assert ticks[0] == max(held_tick, new_tick)


gradient = st.sampled_from([NAN, 0.0, 0.1, 0.17, 0.18, -0.1, 1.0, 5.0]) | st.floats(-6, 6)
confidence = st.sampled_from([0.0, 31.0, 63.0, 96.0, 127.0, 128.0, 160.0, 255.0]) | st.floats(0.01, 255)
cell = st.tuples(st.floats(-20, 20), gradient, gradient, st.floats(0, 1) | st.just(NAN), confidence).map(
    lambda c: oracle.stored(c if c[4] > 0 else (NAN, NAN, NAN, NAN, 0.0))
)
RULES = [
    (PAPER, oracle.Rules()),
    (GATED, oracle.Rules(60.0, 1.0)),
    (Rules(1.0, 3.0, 40.0, True), oracle.Rules(1.0, 3.0, 40.0, True)),
]


@settings(max_examples=300, deadline=None)
@given(st.lists(st.tuples(cell, cell), min_size=1, max_size=20), st.sampled_from(RULES), st.sampled_from([0.3, None]))
def test_fuse_equals_the_oracle(pairs, both_rules, slope_max):
    rules, oracle_rules = both_rules
    grid = Grid((0.0, 0.0), 1.0, (1, len(pairs)))
    old, new = (map_of(wide(side), grid) for side in zip(*pairs, strict=True))
    expected = [oracle.fuse(a, b, oracle_rules, slope_max) for a, b in pairs]
    np.testing.assert_allclose(values_of(fuse(old, new, rules, slope_max))[:, :5], expected, rtol=1e-6, atol=1e-7)


def test_rescale_by_hand():
    values = np.full((4, 5), NAN, np.float32)
    values[:, 4] = 0.0
    values[0] = 1.0, 0.2, NAN, NAN, 100.0
    values[3] = 2.0, 0.4, 0.1, 0.5, 200.0
    coarse = rescale(map_of(wide(values), Grid((5.0, 5.0), 0.5, (2, 2))), 2)
    assert coarse.grid == Grid((5.0, 5.0), 1.0, (1, 1))
    result = values_of(coarse)[0, :5].tolist()
    assert result == pytest.approx([5 / 3, 1 / 3, 0.1, 0.5, 75.0])


def test_rescale_needs_whole_blocks_and_keeps_the_unknown_unknown():
    fine = CellMap.unknown(Grid((0.0, 0.0), 0.5, (4, 6)))
    assert rescale(fine, 2).equals(CellMap.unknown(Grid((0.0, 0.0), 1.0, (2, 3))))
    with pytest.raises(ValueError, match="multiple of 4"):
        rescale(fine, 4)


@settings(max_examples=100, deadline=None)
@given(st.lists(cell, min_size=24, max_size=24), st.sampled_from([1, 2]))
def test_rescale_equals_the_oracle(cells, factor):
    grid = Grid((0.0, 0.0), 1.0, (4, 6))
    expected = oracle.rescale({divmod(i, 6): c for i, c in enumerate(cells) if c[4] > 0}, factor)
    found = rescale(map_of(wide(cells), grid), factor)
    for index, values in enumerate(values_of(found)[:, :5].tolist()):
        wanted = expected.get(divmod(index, 6 // factor), (NAN, NAN, NAN, NAN, 0.0))
        np.testing.assert_allclose(values, wanted, rtol=1e-6, atol=1e-6, err_msg=f"{index} {MAPPED_LAYERS}")


@settings(max_examples=100, deadline=None)
@given(st.lists(cell, min_size=6, max_size=6), st.sampled_from([1, 3, 10]))
def test_what_is_expanded_rescales_to_itself_bit_for_bit(cells, factor):
    coarse = map_of(wide(cells), Grid((0.0, 0.0), 5.0, (2, 3)))
    assert rescale(expand(coarse, factor), factor).equals(coarse)
