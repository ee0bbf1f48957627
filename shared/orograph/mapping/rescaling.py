"""HRM to LLRM: many fine cells to one coarse cell (mapping.md section 4)."""

from __future__ import annotations

import numpy as np

from orograph.layers import CellMap
from orograph.mapping.cells import map_of, unknown_values, values_of
from orograph.mapping.rescaling_kernels import rescale_map


def rescale(fine: CellMap, factor: int) -> CellMap:
    """A map of blocks of factor x factor cells: weighted means, confidence as the sum over the number of cells.

    Given layers are those of each block's first cell; raises ValueError unless the shape divides.
    """
    grid = fine.grid.coarsened(factor)
    values = unknown_values(grid.size)
    rescale_map(values_of(fine), fine.grid.cols, factor, values)
    firsts = fine.gps_quality[::factor, ::factor], fine.communications[::factor, ::factor]
    return map_of(values, grid, firsts)


def expand(coarse: CellMap, factor: int) -> CellMap:
    """The same map on cells `factor` times smaller, each with its coarse cell's values."""
    fine = {name: np.repeat(np.repeat(layer, factor, axis=0), factor, axis=1) for name, layer in coarse.layers()}
    return CellMap(coarse.grid.refined(factor), fine)
