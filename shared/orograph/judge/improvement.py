"""Does mapping improve the map? The prior beside what was made of it, cell by cell against the truth."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from orograph.arrays import Mask
from orograph.grid import Grid
from orograph.judge.map_score import JUDGED, confident, judged, map_figures
from orograph.judge.map_truth import MapTruth
from orograph.layers import BASIC_LAYERS, CellMap
from orograph.mapping.cells import cut
from orograph.mapping.rescaling import expand
from orograph.storage.results import Improvement, MapFigures, PriorAndFinal


@dataclass(frozen=True, eq=False)
class BeforeAfter:
    """One map, what it began as, and the truth, all over one grid."""

    prior: CellMap
    final: CellMap
    truth: MapTruth
    touched: Mask
    """Cells (rows, cols) of which there is any evidence."""

    @classmethod
    def of(cls, prior: CellMap, final: CellMap, truth: MapTruth) -> BeforeAfter:
        """Touched is what differs: the way to tell where the evidence itself was not kept."""
        pairs = [(prior.by_name[name], final.by_name[name]) for name in BASIC_LAYERS]
        return cls(prior, final, truth, np.any([~((a == b) | (np.isnan(a) & np.isnan(b))) for a, b in pairs], axis=0))


def improvement(maps: Sequence[BeforeAfter]) -> Improvement:
    """Maps of a kind pooled: on the cells that the final map is confident of, and on all that were touched."""
    sure, touched = [confident(m.final, m.truth) for m in maps], [m.touched for m in maps]
    return Improvement(confident=_both(maps, sure), touched=_both(maps, touched))


def prior_over(prior: CellMap, grid: Grid) -> CellMap:
    """The global prior cut into the cells of a local map's aligned grid, unknown beyond its edge."""
    factor = round(prior.grid.cell_m / grid.cell_m)
    coarse = grid.coarsened(factor)
    row = round((coarse.origin_m[1] - prior.grid.origin_m[1]) / coarse.cell_m)
    col = round((coarse.origin_m[0] - prior.grid.origin_m[0]) / coarse.cell_m)
    return expand(cut(prior, row, col, coarse.shape), factor)


def _both(maps: Sequence[BeforeAfter], where: Sequence[Mask]) -> PriorAndFinal:
    def figures(cells: Sequence[CellMap]) -> MapFigures:
        parts = [judged(c, m.truth, mask) for c, m, mask in zip(cells, maps, where, strict=True)]
        return MapFigures.model_validate(map_figures(np.concatenate([np.zeros(0, JUDGED), *parts])))

    return PriorAndFinal(prior=figures([m.prior for m in maps]), final=figures([m.final for m in maps]))
