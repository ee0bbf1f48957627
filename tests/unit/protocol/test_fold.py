"""The integer fold: hand-computed cells, then the slow reference on random ones."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from made_up.cells import GATED
from oracles.fold_oracle import ageing, fold_cell
from orograph.layers import BASIC_LAYERS, UNKNOWN_GRADIENT, UNKNOWN_OCCUPATION
from orograph.messages import REGISTER, ROBOT_REGISTER, UPDATE
from orograph.protocol.fold import AGEING, fold, fold_registers
from orograph.rules import PAPER, Rules


@dataclass
class Cell:
    height: int = 0
    gradient_x: int = 0
    gradient_y: int = 0
    occupation: int = 0
    confidence: int = 0
    tick: int = 0


NOTHING = Cell()


def one(prior: Cell, *registers: Cell, rules: Rules = GATED) -> tuple[int, ...]:
    """The folded (height, gradient_x, gradient_y, occupation, confidence) of one cell."""
    base, rows = np.zeros(1, UPDATE), np.zeros((len(registers), 1), REGISTER)
    for name, value in vars(prior).items():
        base[name] = value
    for line, register in enumerate(registers):
        for name, value in vars(register).items():
            rows[name][line] = value
    out = fold(base, rows, rules)
    return tuple(int(out[name][0]) for name in BASIC_LAYERS)


def test_no_register_leaves_the_prior():
    assert one(Cell(7, 1, 2, 3, 32)) == (7, 1, 2, 3, 32)


def test_unknown_prior_gives_way():
    assert one(NOTHING, Cell(500, 10, 20, 30, 3)) == (500, 10, 20, 30, 3)


def test_similar_cells_are_weighted_by_confidence():
    # heights (100*1 + 200*3) / 4 = 175; gradients (0*1 + 100*3) / 4 = 75; occupation (10*1 + 21*3) / 4 = 18.25 -> 18
    assert one(Cell(100, 0, 0, 10, 1), Cell(200, 100, 100, 21, 3)) == (175, 75, 75, 18, 4)


@pytest.mark.parametrize(
    ("a", "b", "mean"), [(0, 1, 1), (0, -1, -1), (2, 3, 3), (-2, -3, -3), (-1, 0, -1), (1, 0, 1), (0, 0, 0)]
)
def test_halves_are_rounded_away_from_zero(a, b, mean):
    assert one(Cell(a, confidence=10), Cell(b, confidence=10))[0] == mean


def test_confidence_stops_at_255():
    assert one(Cell(confidence=200), Cell(confidence=100))[4] == 255


def test_default_height_gate_keeps_a_roof_from_a_road():
    # 1 mm over the gate: not similar; |40 - 32| is low and both are low, so the higher confidence is taken.
    assert one(Cell(0, confidence=32), Cell(1001, confidence=40)) == (1001, 0, 0, 0, 40)
    assert one(Cell(0, confidence=32), Cell(1001, confidence=31)) == (0, 0, 0, 0, 32)
    assert one(Cell(0, confidence=32), Cell(1000, confidence=32)) == (500, 0, 0, 0, 64)


def test_paper_has_no_height_gate():
    assert one(Cell(0, confidence=32), Cell(9000, confidence=32), rules=PAPER) == (4500, 0, 0, 0, 64)


def test_slopes_just_within_and_beyond_ten_degrees():
    # tan 10 deg = 0.17633: a gradient of 1763 against level ground is similar, 1764 is not.
    assert one(Cell(confidence=10), Cell(0, 1763, 0, 0, 10))[4] == 20
    assert one(Cell(confidence=10), Cell(0, 1764, 0, 0, 10)) == (0, 1764, 0, 0, 10)


def test_opposite_walls_are_never_similar():
    assert one(Cell(0, 32767, 0, 0, 10), Cell(0, -32767, 0, 0, 10)) == (0, -32767, 0, 0, 10)


def test_saturated_gradients_do_not_overflow():
    assert one(Cell(0, 32767, 0, 0, 10), Cell(0, 32766, 0, 0, 10)) == (0, 32767, 0, 0, 20)


def test_high_difference_takes_the_higher_whole():
    # 2/16 of 255 is 31.875: a difference of 32 is high, of 31 is not.
    assert one(Cell(0, confidence=200), Cell(5000, confidence=168)) == (0, 0, 0, 0, 200)
    assert one(Cell(0, confidence=200), Cell(5000, confidence=169)) == (5000, 0, 0, 0, 169)


def test_new_replaces_old_when_both_are_high():
    assert one(Cell(0, confidence=150), Cell(5000, confidence=128)) == (5000, 0, 0, 0, 128)
    assert one(Cell(0, confidence=150), Cell(5000, confidence=127)) == (0, 0, 0, 0, 150)


def test_new_wins_a_tie():
    assert one(Cell(0, confidence=50), Cell(5000, confidence=50)) == (5000, 0, 0, 0, 50)


def test_printed_equation_12_asks_the_new_confidence_alone():
    # Both high, difference low: ours replaces the old; as printed the difference counts as high, the higher is taken.
    rules = Rules(60.0, 1.0, printed_equation_12=True)
    assert one(Cell(0, confidence=150), Cell(5000, confidence=140), rules=rules) == (0, 0, 0, 0, 150)


def test_unknown_values_are_taken_from_the_side_that_knows():
    prior = Cell(0, UNKNOWN_GRADIENT, 40, UNKNOWN_OCCUPATION, 10)
    assert one(prior, Cell(0, 5000, UNKNOWN_GRADIENT, 100, 10)) == (0, 5000, 40, 100, 20)
    assert one(prior, Cell(0, UNKNOWN_GRADIENT, 40, UNKNOWN_OCCUPATION, 10)) == (
        0, UNKNOWN_GRADIENT, 40, UNKNOWN_OCCUPATION, 20,
    )  # fmt: skip


def test_contribution_ages_to_the_newest_tick_in_the_cell():
    # 60 s is one half-life: 100 -> 50; (0*50 + 300*100) / 150 = 200.
    assert one(NOTHING, Cell(0, confidence=100, tick=0), Cell(300, confidence=100, tick=60_000)) == (200, 0, 0, 0, 150)


def test_order_is_by_tick_then_robot():
    late, early = Cell(5000, confidence=140, tick=60), Cell(0, confidence=150, tick=50)
    assert one(NOTHING, late, early)[0] == 5000
    assert one(NOTHING, Cell(0, confidence=150, tick=60), Cell(5000, confidence=140, tick=60))[0] == 5000


def test_prior_does_not_age():
    for tick in (0, 600_000):
        assert one(Cell(0, confidence=32), Cell(400, confidence=32, tick=tick)) == (200, 0, 0, 0, 64)


def test_contribution_aged_to_nothing_gives_way():
    assert one(NOTHING, Cell(0, confidence=255, tick=0), Cell(300, confidence=1, tick=2**31))[0] == 300


def test_ageing_table_is_the_rounded_power_of_two():
    assert AGEING.tolist() == [ageing(step) for step in range(256)]


whole = st.integers
gradients = st.one_of(whole(-3000, 3000), st.sampled_from([UNKNOWN_GRADIENT, -32767, 32767]))
cells = st.builds(
    Cell, whole(-2_000, 2_000), gradients, gradients, whole(0, 255), whole(0, 255),
    st.one_of(whole(0, 300_000), st.just(2**32 - 1)),
)  # fmt: skip
rule_sets = st.builds(
    Rules,
    st.sampled_from([math.inf, 0.001, 0.977, 60.0]),
    st.sampled_from([math.inf, 1e-6, 1.0]),
    printed_equation_12=st.booleans(),
)


@settings(max_examples=300, deadline=None)
@given(cells, st.lists(cells, max_size=5), rule_sets)
def test_fold_equals_the_reference(prior, registers, rules):
    rows = np.zeros(len(registers), ROBOT_REGISTER)
    base = np.zeros(1, UPDATE)
    for name, value in vars(prior).items():
        base[name] = value
    for number, register in enumerate(registers):
        rows["robot"][number] = number + 1
        for name, value in vars(register).items():
            rows[name][number] = value
    assert one(prior, *registers, rules=rules) == fold_cell(base[0], list(rows), rules.whole())


@settings(max_examples=50, deadline=None)
@given(st.lists(cells, max_size=12), st.randoms(use_true_random=False))
def test_map_depends_on_the_set_of_registers_alone(contributions, random):
    prior = np.zeros(4, UPDATE)
    prior["cell"], prior["confidence"] = np.arange(4), 32
    rows = np.zeros(len(contributions), ROBOT_REGISTER)
    for i, contribution in enumerate(contributions):
        rows["cell"][i], rows["robot"][i] = i % 4, 1 + i // 4
        for name, value in vars(contribution).items():
            rows[name][i] = value
    shuffled = list(range(len(rows)))
    random.shuffle(shuffled)
    once, again = (fold_registers(prior, x, GATED) for x in (rows, rows[shuffled]))
    assert np.array_equal(once, again)
