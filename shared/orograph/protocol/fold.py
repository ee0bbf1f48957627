"""The fold: GLRM cell = pure integer function of the prior and the robots' registers (mapping.md section 5).

Readings that the text leaves open, decided here:
- **The prior does not age.** mapping.md decays "each contribution"; the prior is named beside the contributions, is no
  measurement and has no time of its own. Its tick 0 says only that it comes first. So the same scans give the same map
  whenever the mission starts.
- Ageing is `c * 2^(-floor(256 age / half-life) / 256)` in units of 1/256 of a confidence step, by an integer table.
- Means are rounded to the nearest integer, halves away from zero.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from orograph.arrays import I64, Mask
from orograph.messages import CELL, REGISTER, UPDATE, Packed
from orograph.protocol.fold_kernels import AGEING_STEPS, fold_cells

if TYPE_CHECKING:
    from typing import Literal

    from orograph.scenario import RulesSpec

VALUES = ("height", "gradient_x", "gradient_y", "occupation", "confidence")
"""What a cell holds, in the canonical order of hashes."""
ROBOT_REGISTER = np.dtype([("robot", "<u2"), *[(n, REGISTER[n]) for n in REGISTER.names or ()]])
"""A register with the number of its robot: the form in which a run folder keeps them."""


def _ageing_table() -> I64:
    """2^16 * 2^(-i/256), rounded: nested integer square roots, so no two hosts can differ."""
    table = []
    for i in range(AGEING_STEPS):
        root = 1 << (17 * AGEING_STEPS - i)
        for _ in range(AGEING_STEPS.bit_length() - 1):
            root = math.isqrt(root)
        table.append((root + 1) >> 1)
    return np.array(table, np.int64)


AGEING = _ageing_table()
_TANGENT_ONE = 10**9


@dataclass(frozen=True)
class FoldRules:
    """Fusion rules in the fold's integers; None means no ageing, no height gate."""

    half_life_ms: int | None = 60_000
    height_gate_mm: int | None = 1_000
    similar_n: int = 173_648_178
    """similar_n / similar_d is the tangent of the angle up to which slopes are similar: here 10 degrees."""
    similar_d: int = 984_807_753
    printed_equation_12: bool = False

    @classmethod
    def paper(cls) -> FoldRules:
        """The paper's rules: no height gate, no decay."""
        return cls(half_life_ms=None, height_gate_mm=None)

    @classmethod
    def of(cls, rules: Literal["paper", "default"] | RulesSpec) -> FoldRules:
        """A scenario's rules as integers."""
        if isinstance(rules, str):
            return cls.paper() if rules == "paper" else cls()
        angle = math.radians(rules.similarity_deg)
        return cls(
            half_life_ms=None if math.isinf(rules.half_life_s) else max(1, round(rules.half_life_s * 1000)),
            height_gate_mm=None if math.isinf(rules.height_gate_m) else round(rules.height_gate_m * 1000),
            similar_n=round(math.sin(angle) * _TANGENT_ONE),
            similar_d=round(math.cos(angle) * _TANGENT_ONE),
            printed_equation_12=rules.printed_equation_12,
        )


def fold(prior: Packed, registers: Packed, rules: FoldRules) -> Packed:
    """GLRM cells (n,) of dtype CELL, version 0, from prior RECORDs (n,) and registers (robots, n).

    Registers are UPDATE or REGISTER, one row per robot in ascending order of robot number, confidence 0 where a
    robot has no evidence; column i belongs to prior[i] (mapping.md section 5).
    """
    assert registers.ndim == 2 and registers.shape[1:] == prior.shape, (registers.shape, prior.shape)
    out = np.zeros(prior.shape, CELL)
    out["cell"] = prior["cell"]
    half_life = 0 if rules.half_life_ms is None else rules.half_life_ms
    gate = -1 if rules.height_gate_mm is None else rules.height_gate_mm
    fold_cells(
        prior, registers, half_life, gate, rules.similar_n, rules.similar_d, rules.printed_equation_12, AGEING, out
    )
    return out


def fold_registers(prior: Packed, registers: Packed, rules: FoldRules) -> Packed:
    """The whole GLRM (n,), CELL, from the prior of every cell (n,) and ROBOT_REGISTER records (m,) in any order."""
    numbers = np.unique(registers["robot"])
    rows = np.zeros((len(numbers), len(prior)), REGISTER)
    rank = np.searchsorted(numbers, registers["robot"])
    for name in REGISTER.names or ():
        rows[name][rank, registers["cell"].astype(np.int64)] = registers[name]
    return fold(prior, rows, rules)


def same_values(a: Packed, b: Packed, *more: str) -> Mask:
    """Where two arrays of records (n,) agree in all values of a cell, and in the fields named besides."""
    same = np.ones(a.shape, np.bool_)
    for name in (*VALUES, *more):
        same &= a[name] == b[name]
    return same


def whole_prior(prior: Packed, size: int) -> Packed:
    """The prior as RECORDs in order of cell; asserts that it names every cell once."""
    ordered: npt.NDArray[Any] = prior[np.argsort(prior["cell"], kind="stable")]
    assert ordered.dtype == UPDATE and np.array_equal(ordered["cell"], np.arange(size)), (
        "prior must name every cell once"
    )
    return ordered
