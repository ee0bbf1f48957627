"""The fold of two surfaces: what it is for, by hand, then the slow reference on random cells."""

from __future__ import annotations

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from oracles.surface_oracle import NAMES, NO_TOP, fold_surfaces
from orograph.layers import MAPPED_LAYERS, UNKNOWN_GRADIENT
from orograph.messages import ROBOT_REGISTER, UPDATE
from orograph.protocol.fold import fold_registers
from orograph.rules import SURFACE, Rules

GROUND = {"confidence": 32, "free_share": 200, "height_top": NO_TOP}
HOUSE = {"confidence": 32, "occupation": 254, "height_top": 10_000, "confidence_top": 32, "wall_share": 200}


def record(dtype: np.dtype, **values: int) -> np.ndarray:
    out = np.zeros(1, dtype)
    for name, value in {"height_top": NO_TOP, **values}.items():
        out[name] = value
    return out


def folded(prior: dict[str, int], *registers: dict[str, int], rules: Rules = SURFACE) -> dict[str, int]:
    rows = [record(ROBOT_REGISTER, robot=i + 1, **values) for i, values in enumerate(registers)]
    cell = fold_registers(record(UPDATE, **prior), np.concatenate([np.zeros(0, ROBOT_REGISTER), *rows]), rules)
    return {name: int(cell[name][0]) for name in MAPPED_LAYERS}


def test_a_prior_alone_stays() -> None:
    for prior in (GROUND, HOUSE):
        found = folded(prior)
        assert {name: found[name] for name in prior} == prior


def test_the_prior_gives_way_to_what_was_measured() -> None:
    """Half a metre of wrong ground: nothing of it is left from the prior's own confidence on."""
    wrong = {**GROUND, "height": 200}
    assert folded(wrong, {"confidence": 32, "free_share": 150})["height"] == 0
    assert folded(wrong, {"confidence": 8, "free_share": 150})["height"] == 150
    assert folded(wrong, {"confidence": 8, "free_share": 150})["confidence"] == 32


def test_a_wall_bars_a_cell_of_the_street_only_where_little_of_it_is_free() -> None:
    facade = {"confidence": 100, "confidence_top": 90, "height_top": 6_000, "wall_share": 20}
    assert folded(GROUND, {**facade, "free_share": 160, "occupation": 12})["occupation"] == 12
    assert folded(GROUND, {**facade, "free_share": 80, "occupation": 12})["occupation"] == 254


def test_few_walls_bar_where_the_prior_knows_of_a_house() -> None:
    seen = {"confidence": 20, "confidence_top": 20, "height_top": 6_000, "wall_share": 8, "free_share": 40}
    assert folded(HOUSE, seen)["occupation"] == 254
    assert folded(GROUND, seen)["occupation"] == 0


def test_a_house_of_which_little_was_seen_is_doubtful() -> None:
    seen = {"confidence": 20, "confidence_top": 90, "height_top": 6_000, "wall_share": 20, "free_share": 40}
    assert folded(GROUND, seen)["occupation"] == round(0.8 * 254)
    assert folded(GROUND, {**seen, "free_share": 90})["occupation"] == 254


def test_a_house_that_is_not_there_goes_top_and_all() -> None:
    found = folded(HOUSE, {"confidence": 60, "free_share": 120, "occupation": 3})
    assert (found["occupation"], found["height_top"], found["confidence_top"]) == (3, NO_TOP, 0)


def test_the_highest_that_anybody_saw_is_the_top() -> None:
    low, high = ({"confidence_top": 100, "height_top": h, "wall_share": 30} for h in (4_000, 9_000))
    assert folded(HOUSE, low, high)["height_top"] == folded(HOUSE, high, low)["height_top"] == 9_000
    assert folded(HOUSE, low, high)["confidence_top"] == 200


def test_only_walls_seen_leave_the_ground_to_the_prior() -> None:
    found = folded({**GROUND, "height": 700}, {"confidence_top": 90, "height_top": 4_000, "wall_share": 30})
    assert (found["height"], found["confidence"], found["height_top"]) == (700, 32, 4_000)


whole = st.integers
slopes = st.one_of(whole(-3000, 3000), st.just(UNKNOWN_GRADIENT))
cells = st.fixed_dictionaries({
    "height": whole(-500, 500), "gradient_x": slopes, "gradient_y": slopes, "occupation": whole(0, 255),
    "confidence": st.one_of(st.just(0), whole(0, 255)), "height_top": whole(0, 9_000),
    "confidence_top": st.one_of(st.just(0), whole(0, 255)), "wall_share": st.one_of(st.just(0), whole(0, 200)),
    "free_share": whole(0, 200), "tick": st.one_of(whole(0, 300_000), st.just(2**32 - 1)),
})  # fmt: skip
rule_sets = st.builds(Rules, st.sampled_from([0.977, 60.0]), st.sampled_from([0.3, 1.0]), st.just(10.0), st.booleans(),
                      st.just(True))  # fmt: skip


@settings(max_examples=300, deadline=None)
@given(cells, st.lists(cells, max_size=4), rule_sets)
def test_it_equals_the_reference(prior, registers, rules) -> None:
    rows = [record(ROBOT_REGISTER, robot=i + 1, **values)[0] for i, values in enumerate(registers)]
    wanted = fold_surfaces(record(UPDATE, **prior)[0], rows, rules.whole())
    found = folded(prior, *registers, rules=rules)
    if wanted[6] == 0:
        found["height_top"] = wanted[5]  # of no confidence: says nothing
    assert tuple(found[name] for name in NAMES) == wanted


@settings(max_examples=100, deadline=None)
@given(cells, st.lists(cells, min_size=2, max_size=4), st.randoms(use_true_random=False))
def test_it_depends_on_the_set_of_registers_alone(prior, registers, random) -> None:
    rows = [record(ROBOT_REGISTER, robot=i + 1, **values) for i, values in enumerate(registers)]
    base = record(UPDATE, **prior)
    once = fold_registers(base, np.concatenate(rows), SURFACE)
    random.shuffle(rows)
    assert np.array_equal(once, fold_registers(base, np.concatenate(rows), SURFACE))
