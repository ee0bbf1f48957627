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
from typing import Any

import numpy as np
import numpy.typing as npt

from orograph.arrays import I64, Mask
from orograph.layers import MAPPED_LAYERS
from orograph.messages import CELL, REGISTER, UPDATE, Packed
from orograph.protocol.fold_kernels import AGEING_STEPS, fold_cells, fold_surfaces
from orograph.rules import Rules


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


def fold(prior: Packed, registers: Packed, rules: Rules) -> Packed:
    """GLRM cells (n,) of dtype CELL, version 0, from prior RECORDs (n,) and registers (robots, n).

    Registers are UPDATE or REGISTER, one row per robot in ascending order of robot number, confidence 0 where a
    robot has no evidence; column i belongs to prior[i] (mapping.md section 5).
    """
    assert registers.ndim == 2 and registers.shape[1:] == prior.shape, (registers.shape, prior.shape)
    out = np.zeros(prior.shape, CELL)
    out["cell"] = prior["cell"]
    (fold_surfaces if rules.two_surfaces else fold_cells)(prior, registers, rules.whole(), AGEING, out)
    return out


def fold_registers(prior: Packed, registers: Packed, rules: Rules) -> Packed:
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
    for name in (*MAPPED_LAYERS, *more):
        same &= a[name] == b[name]
    return same


def whole_prior(prior: Packed, size: int) -> Packed:
    """The prior as RECORDs in order of cell; asserts that it names every cell once."""
    ordered: npt.NDArray[Any] = prior[np.argsort(prior["cell"], kind="stable")]
    assert ordered.dtype == UPDATE and np.array_equal(ordered["cell"], np.arange(size)), (
        "prior must name every cell once"
    )
    return ordered
