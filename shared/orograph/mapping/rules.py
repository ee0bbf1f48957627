"""The numbers of the fusion rule, named sets and a scenario's own (mapping.md section 3)."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal, NamedTuple, Self

from orograph.scenario import RulesSpec

SLOPE_MAX = 0.3
"""Largest passable slope of the paper's robot (mapping.md section 2.3)."""


class RuleNumbers(NamedTuple):
    """What the compiled fusion reads; slope_max NaN means that occupation is fused like height."""

    half_life_ms: float
    height_gate_m: float
    tan_similarity: float
    printed: bool
    slope_max: float


@dataclass(frozen=True)
class FusionRules:
    """When two cells count as the same surface, and how fast confidence decays."""

    half_life_s: float = math.inf
    height_gate_m: float = math.inf
    similarity_deg: float = 10.0
    printed_equation_12: bool = False

    @classmethod
    def paper(cls) -> Self:
        """No height gate, no decay."""
        return cls()

    @classmethod
    def default(cls) -> Self:
        """1 m height gate, 60 s half-life."""
        return cls(half_life_s=60.0, height_gate_m=1.0)

    @classmethod
    def of(cls, rules: Literal["paper", "default"] | RulesSpec) -> Self:
        """The rules that a scenario names or spells out."""
        if isinstance(rules, RulesSpec):
            return cls(**rules.model_dump())
        return {"paper": cls.paper, "default": cls.default}[rules]()

    def numbers(self, slope_max: float | None) -> RuleNumbers:
        """For the kernels; `slope_max` None fuses occupation like height (map level: LLRM, GLRM)."""
        tan_similarity = math.tan(math.radians(self.similarity_deg))
        slope = math.nan if slope_max is None else slope_max
        return RuleNumbers(self.half_life_s * 1e3, self.height_gate_m, tan_similarity, self.printed_equation_12, slope)
