"""A cell explained: the same numbers as kernel and slow reference, and the rules' words for cells set by hand."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from made_up.cells import records
from oracles.fold_oracle import fold_cell
from oracles.surface_oracle import NAMES, fold_surfaces
from orograph.layers import BASIC_LAYERS, HEIGHT, MAPPED_LAYERS, UNKNOWN_GRADIENT
from orograph.messages import ROBOT_REGISTER, UPDATE
from orograph.protocol.explained import PRIOR, Explanation, explain
from orograph.protocol.fold import fold_registers
from orograph.registers import numbers
from orograph.rules import SURFACE, Rules

GATED = Rules(half_life_s=60.0, height_gate_m=1.0)
whole = st.integers
slopes = st.one_of(whole(-3000, 3000), st.just(UNKNOWN_GRADIENT))
shares = st.one_of(st.just(0), whole(0, 200))
confidences = st.one_of(st.just(0), whole(0, 255))
cells = st.fixed_dictionaries({
    "height": whole(-1500, 1500), "gradient_x": slopes, "gradient_y": slopes, "occupation": whole(0, 255),
    "confidence": confidences, "height_top": whole(0, 9_000), "confidence_top": confidences, "wall_share": shares,
    "free_share": shares, "tick": st.one_of(whole(0, 300_000), st.just(2**32 - 1)),
})  # fmt: skip
rule_sets = st.builds(
    Rules, st.sampled_from([0.977, 60.0, np.inf]), st.sampled_from([0.3, 1.0, np.inf]),
    printed_equation_12=st.booleans(), two_surfaces=st.booleans(),
)  # fmt: skip


def told(prior: dict[str, int], *registers: dict[str, int], rules: Rules = GATED) -> Explanation:
    rows = records(ROBOT_REGISTER, *({"robot": i + 1, **cell} for i, cell in enumerate(registers)))
    return explain(records(UPDATE, prior)[0], rows, rules)


@settings(max_examples=300, deadline=None)
@given(cells, st.lists(cells, max_size=5), rule_sets, st.randoms(use_true_random=False))
def test_it_is_the_fold_and_the_reference(prior, registers, rules, random) -> None:
    base = records(UPDATE, prior)
    rows = records(ROBOT_REGISTER, *({"robot": i + 1, **cell} for i, cell in enumerate(registers)))
    rows["confidence_top"] *= rules.two_surfaces
    order = list(range(len(rows)))
    random.shuffle(order)
    found = explain(base[0], rows[order], rules)
    assert np.array_equal(found.result, numbers(fold_registers(base, rows, rules))[0])
    named = dict(zip(MAPPED_LAYERS, found.result.tolist(), strict=True))
    if rules.two_surfaces:
        wanted = dict(zip(NAMES, fold_surfaces(base[0], list(rows), rules.whole()), strict=True))
        if wanted["confidence_top"] == 0:
            wanted["height_top"] = named["height_top"]  # of no confidence: says nothing
    else:
        wanted = dict(zip(BASIC_LAYERS, fold_cell(base[0], list(rows), rules.whole()), strict=True))
    assert {name: named[name] for name in wanted} == wanted


@settings(max_examples=100, deadline=None)
@given(cells, st.lists(cells, max_size=5), rule_sets)
def test_it_names_every_contribution_once_in_order(prior, registers, rules) -> None:
    steps = told(prior, *registers, rules=rules).steps
    robots = [step for step in steps if step.robot != PRIOR]
    assert len(steps) == len(robots) + 1 and steps[-1 if rules.two_surfaces else 0].robot == PRIOR
    assert [(s.tick_ms, s.robot) for s in robots] == sorted((s.tick_ms, s.robot) for s in robots)
    assert all(0 <= s.weight <= max(s.said[4], 0) and (s.similar is None) <= (s.decided != "mean") for s in steps)


@pytest.mark.parametrize(
    ("prior", "new", "similar", "decided", "height"),
    [
        ((0, 0), (7, 9), None, "the first", 7),
        ((100, 30), (200, 30), True, "mean by confidence", 150),
        ((0, 32), (5000, 40), False, "surer, taken", 5000),
        ((0, 32), (5000, 90), False, "much surer, taken", 5000),
        ((0, 90), (5000, 32), False, "much less sure", 0),
        ((0, 40), (5000, 32), False, "less sure", 0),
        ((0, 32), (5000, 32), False, "as sure, newer", 5000),
        ((0, 150), (5000, 140), False, "both sure: the newer", 5000),
    ],
)
def test_it_says_which_rule_decided(prior, new, similar, decided, height) -> None:
    (_, step) = told(*({"height": h, "confidence": c} for h, c in (prior, new))).steps
    assert (step.similar, step.decided, step.held[HEIGHT]) == (similar, decided, height)


def test_it_says_by_how_much_a_contribution_aged() -> None:
    old, new = {"confidence": 100, "tick": 0}, {"confidence": 100, "tick": 60_000}
    assert [s.weight for s in told({}, new, old).steps] == [0, 50, 100]
    assert [s.robot for s in told({}, new, old).steps] == [PRIOR, 2, 1]
    gone = told({}, {"confidence": 100, "tick": 0}, {"confidence": 9, "tick": 2**31}).steps[1]
    assert (gone.weight, gone.decided) == (0, "of no weight")


def test_it_says_what_bars_a_cell_and_what_is_left_of_the_prior() -> None:
    house = {"confidence": 32, "occupation": 254, "height_top": 10_000, "confidence_top": 32, "wall_share": 200}
    seen = {"confidence": 20, "confidence_top": 90, "height_top": 6_000, "wall_share": 8, "free_share": 40, "tick": 1}
    gone = {"confidence": 20, "free_share": 120, "tick": 2}
    steps = told(house, seen, gone, rules=SURFACE).steps
    assert [s.bars for s in steps] == ["barred", "by slope", "by slope"]
    assert (steps[-1].robot, steps[-1].weight, steps[-1].top_weight) == (PRIOR, pytest.approx(0, abs=13), 0)
