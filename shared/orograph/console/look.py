"""The map of a film at a time, as layers that can be coloured."""

from __future__ import annotations

import numpy as np

from orograph.arrays import F64
from orograph.console.colours import Look
from orograph.console.film import Film, MapCourse
from orograph.judge.map_score import top_m
from orograph.judge.map_truth import NEAR_GLRM, PLACES_GLRM, true_map
from orograph.layers import CellMap
from orograph.registers import unpack
from orograph.scene.site import Site


class Looker:
    """Makes the look at any time of one film; what is dear is made once, and only if somebody wants it."""

    def __init__(self, site: Site) -> None:
        self._site, self._grid = site, site.scenario.grid.grid
        self.course = MapCourse(site.prior)
        self._prior_m = top_m(site.prior_map)
        self._truth_m: tuple[int, F64] = (0, np.full(self._grid.shape, np.nan))
        known = self._prior_m[np.isfinite(self._prior_m)]
        low, high = np.quantile(known, [0.002, 0.998]) if len(known) else (0.0, 10.0)
        self._range_m = float(low), float(max(high, low + 5.0))

    def look(self, film: Film, stamp_ns: int, with_truth: bool) -> Look:
        """The look at a time; `truth_m` is NaN unless asked for."""
        self.course.seek(film.changes, stamp_ns)
        cells = self.cells()
        age_s = np.where(self.course.changed_ns < 0, np.nan, (stamp_ns - self.course.changed_ns) * 1e-9)
        return Look(
            top_m(cells), self._prior_m, self.truth_m(stamp_ns) if with_truth else np.full_like(self._prior_m, np.nan),
            cells.occupation, cells.by_name["confidence"], age_s.reshape(self._grid.shape), self._range_m,
        )  # fmt: skip

    def cells(self) -> CellMap:
        """All layers of the map at the time last asked for."""
        return unpack(self.course.cells, self._grid, *self._site.given)

    def truth_m(self, stamp_ns: int) -> F64:
        """True upper surface (rows, cols) [m] at a time: the highest top where something stands, else the ground."""
        scene = self._site.scene(stamp_ns)
        if self._truth_m[0] != id(scene):
            truth = true_map(scene, self._grid, PLACES_GLRM, NEAR_GLRM)
            self._truth_m = id(scene), np.where(truth.roof & np.isfinite(truth.top_m), truth.top_m, truth.ground_m)
        return self._truth_m[1]
