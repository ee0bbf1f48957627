"""Fusion of two maps, cell by cell (mapping.md section 3)."""

from __future__ import annotations

import numpy as np

from orograph.layers import CellMap
from orograph.mapping.cells import map_of, values_of
from orograph.mapping.fusion_kernels import fuse_cells
from orograph.mapping.standing_kernels import lay_map_over
from orograph.rules import SLOPE_MAX, Rules


def fuse(old: CellMap, new: CellMap, rules: Rules, slope_max: float | None = SLOPE_MAX) -> CellMap:
    """A new map of two over one grid whose confidences have decayed already; given layers are those of `old`.

    Occupation follows from the fused gradients and `slope_max`; with None it is fused like height (map level).
    """
    assert old.grid == new.grid, (old.grid, new.grid)
    values, same_time = values_of(old), np.zeros(old.grid.size, np.uint32)
    everywhere = np.arange(old.grid.size)
    fuse_cells(values, same_time, everywhere, values_of(new), same_time, rules.real(slope_max))
    return map_of(values, old.grid, (old.gps_quality, old.communications))


def lay_over(prior: CellMap, own: CellMap, rules: Rules, slope_max: float = SLOPE_MAX) -> CellMap:
    """A map of what was measured over a prior that gives way to it, by rules with two surfaces; both of one grid."""
    assert prior.grid == own.grid, (prior.grid, own.grid)
    values = values_of(own)
    lay_map_over(values_of(prior), values.copy(), rules.real(slope_max), values)
    return map_of(values, own.grid, (prior.gps_quality, prior.communications))
