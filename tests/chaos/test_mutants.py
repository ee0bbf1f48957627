"""Two broken services in real containers, each of which must turn the chaos suite red."""

from __future__ import annotations

import pytest
from chaos.experiments import EXPERIMENTS, Experiment
from chaos.runner import carry_out

pytestmark = pytest.mark.containers
MUTANTS = [e for e in EXPERIMENTS if e.must_be_red]
CAUGHT_BY = {"M1": "1:", "M2": "3:"}
"""The invariant that each of them breaks."""


@pytest.mark.parametrize("mutant", MUTANTS, ids=lambda e: e.name)
def test_a_mutant_turns_the_suite_red(mutant: Experiment) -> None:
    verdict = carry_out(mutant)
    assert verdict["ok"], verdict
    assert any(found.startswith(CAUGHT_BY[mutant.name]) for found in verdict["violations"]), verdict["violations"]
