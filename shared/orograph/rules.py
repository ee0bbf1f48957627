"""The mapping rules and their numbers, once: as a scenario gives them, as kernels and as the fold read them.

mapping.md section 3. The robots fuse in floating point (`Rules.real`), the fold in integers (`Rules.whole`).
"""

from __future__ import annotations

import math
from typing import Annotated, Literal, NamedTuple

from pydantic import ConfigDict, Field
from pydantic.dataclasses import dataclass

SLOPE_MAX = 0.3
"""Largest passable slope of the paper's robot (mapping.md section 2.3)."""
# What bars a block or cell by the rule set `surface`, for robots and fold alike (mapping.md section 7).
FREE_SHARE_OPEN = 0.6
WALL_SHARE_RIM = 0.1
"""A block of which more than 6/10 is free is no house; walls of up to a tenth are a rim, half of it free."""
FREE_SHARE_SEEN = 0.25
"""Of so much seen: a cell that is free and shows no wall is no house either."""
TOP_SURE, SHARE_HALF = 64, 0.5
"""A house that the prior does not know of bars its block: a confident top, and half of the block seen."""
WALL_SHARE_FEW, OCCUPATION_DOUBTFUL = 0.06, 0.8
"""With more walls, or a confident top, it is a house rather than not: to be driven only where nothing else leads."""
_TANGENT_ONE = 10**9
NamedRules = Literal["surface", "paper"]


class RealRules(NamedTuple):
    """What the compiled kernels read; slope_max NaN means that occupation is fused like height."""

    half_life_ms: float
    height_gate_m: float
    tan_similarity: float
    printed: bool
    slope_max: float
    two_surfaces: bool
    step_m: float
    overhang_m: float


class WholeRules(NamedTuple):
    """What the fold reads: no ageing is a half-life of 0, no height gate is -1.

    similar_n / similar_d is the tangent of the angle up to which slopes are similar.
    """

    half_life_ms: int
    height_gate_mm: int
    similar_n: int
    similar_d: int
    printed: bool
    two_surfaces: bool


@dataclass(frozen=True, config=ConfigDict(extra="forbid", ser_json_inf_nan="strings"))
class Rules:
    """When two cells count as the same surface, and how fast confidence decays; raises ValueError out of bounds."""

    half_life_s: Annotated[float, Field(gt=0)] = math.inf
    height_gate_m: Annotated[float, Field(gt=0)] = math.inf
    similarity_deg: Annotated[float, Field(gt=0, lt=90)] = 10.0
    printed_equation_12: bool = False
    two_surfaces: bool = False
    """Ground and what stands on it are two surfaces (mapping.md section 7); else one mean of all points."""
    step_m: Annotated[float, Field(gt=0)] = 0.3
    """What rises by so much within a fine cell stands there, and bars the robot."""
    overhang_m: Annotated[float, Field(gt=0)] = 1.5
    """What begins higher over the ground than this lets the robot pass below."""

    @classmethod
    def paper(cls) -> Rules:
        """The paper's: no height gate, no decay."""
        return NAMED["paper"]

    @classmethod
    def default(cls) -> Rules:
        """Ground and what stands on it as two surfaces, a half-life of 60 s."""
        return NAMED["surface"]

    @classmethod
    def of(cls, rules: NamedRules | Rules) -> Rules:
        """The rules that a scenario names or spells out."""
        return NAMED[rules] if isinstance(rules, str) else rules

    def real(self, slope_max: float | None) -> RealRules:
        """For the kernels; `slope_max` None fuses occupation like height (map level: LLRM, GLRM)."""
        tan_similarity = math.tan(math.radians(self.similarity_deg))
        slope = math.nan if slope_max is None else slope_max
        return RealRules(
            self.half_life_s * 1e3, self.height_gate_m, tan_similarity, self.printed_equation_12, slope,
            self.two_surfaces, self.step_m, self.overhang_m,
        )  # fmt: skip

    def whole(self) -> WholeRules:
        """For the fold, which every host computes alike."""
        angle = math.radians(self.similarity_deg)
        return WholeRules(
            0 if math.isinf(self.half_life_s) else max(1, round(self.half_life_s * 1000)),
            -1 if math.isinf(self.height_gate_m) else round(self.height_gate_m * 1000),
            round(math.sin(angle) * _TANGENT_ONE),
            round(math.cos(angle) * _TANGENT_ONE),
            self.printed_equation_12,
            self.two_surfaces,
        )


NAMED: dict[str, Rules] = {
    "paper": Rules(),
    "surface": Rules(half_life_s=60.0, height_gate_m=0.3, two_surfaces=True),
}
"""The named sets: `paper` has no height gate and no decay, `surface` parts the ground from what stands on it."""
PAPER, SURFACE = NAMED["paper"], NAMED["surface"]
