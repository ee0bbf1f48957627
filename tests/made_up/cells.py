"""Cells of one surface, (height, gradient_x, gradient_y, occupation, confidence), as the kernels hold them."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike
from orograph.layers import BASIC_LAYERS, UNKNOWN_HEIGHT
from orograph.mapping.cells import unknown_values
from orograph.messages import UPDATE
from orograph.rules import Rules

BASIC = len(BASIC_LAYERS)
GATED = Rules(half_life_s=60.0, height_gate_m=1.0)
"""One surface, with everything of section 3 that the paper's rules leave out."""


def wide(cells: ArrayLike) -> np.ndarray:
    """Values (n, WIDTH) of cells (n, 5); nothing stands in them."""
    basic = np.asarray(cells, np.float32).reshape(-1, BASIC)
    values = unknown_values(len(basic))
    values[:, :BASIC] = basic
    return values


def records(dtype: np.dtype, *cells: dict[str, int]) -> np.ndarray:
    """Registers with these fields, the others 0; nothing is told of what stands unless they do."""
    out = np.zeros(len(cells), dtype)
    out["height_top"] = UNKNOWN_HEIGHT
    for record, cell in zip(out, cells, strict=True):
        for name, value in cell.items():
            record[name] = value
    return out


def flat_prior(size: int) -> np.ndarray:
    """The prior of so many cells: flat at height 0, of confidence 32."""
    prior = np.zeros(size, UPDATE)
    prior["cell"], prior["confidence"] = np.arange(size), 32
    return prior
