"""The rules once: named sets, a scenario's own, and both forms in which they are read."""

import math

import pytest
from made_up.cells import GATED
from orograph.rules import PAPER, SURFACE, Rules
from pydantic import ValidationError


def test_rules_by_name_and_by_numbers():
    assert Rules.of("paper") == Rules() == PAPER
    assert Rules.of("surface") == Rules.default() == SURFACE
    own = Rules(5, 2, 20, True)
    assert Rules.of(own) is own


def test_the_whole_form_has_no_ageing_as_0_and_no_gate_as_minus_1():
    assert PAPER.whole()[:2] == (0, -1)
    assert GATED.whole() == (60_000, 1_000, 173_648_178, 984_807_753, False, False)
    assert Rules(2.5, 0.25, printed_equation_12=True).whole()[:2] == (2_500, 250)
    assert Rules(1e-9).whole().half_life_ms == 1, "0 would be none"
    steep = Rules(similarity_deg=80).whole()
    assert steep.similar_n / steep.similar_d == pytest.approx(math.tan(math.radians(80)))


def test_the_real_form_fuses_occupation_like_height_at_map_level():
    assert GATED.real(0.3)[:2] == (60_000.0, 1.0)
    assert GATED.real(0.3).slope_max == 0.3 and math.isnan(GATED.real(None).slope_max)


@pytest.mark.parametrize("bad", [
    {"half_life_s": 0}, {"height_gate_m": -1}, {"similarity_deg": 90}, {"half_life_s": math.nan}, {"half_live_s": 3},
])  # fmt: skip
def test_rules_that_cannot_be_are_refused_wherever_they_come_from(bad):
    with pytest.raises(ValidationError):
        Rules(**bad)
