"""The map of a film at a time, as layers that can be coloured."""

from __future__ import annotations

from collections.abc import Collection

import numpy as np

from orograph.arrays import F64
from orograph.console.colours import TRUTH, WHO, Look
from orograph.console.film import Film, MapCourse
from orograph.judge.map_score import top_m
from orograph.judge.map_truth import NEAR_GLRM, PLACES_GLRM, true_map
from orograph.layers import CellMap
from orograph.registers import unpack
from orograph.scene.site import Site

AGE_STEP_NS = 5_000_000_000
"""Ages grow in such steps, all at once: the whole map looks different with each."""


class Looker:
    """Makes the look at any time of one film; what is dear is made once, and only if somebody wants it."""

    def __init__(self, site: Site) -> None:
        self._site, self._grid = site, site.scenario.grid.grid
        self.course = MapCourse(site.prior)
        self._prior_m = top_m(site.prior_map)
        self._nothing = np.full(self._grid.shape, np.nan)
        self._truth_m: tuple[int, F64] = (0, np.full(self._grid.shape, np.nan))
        known = self._prior_m[np.isfinite(self._prior_m)]
        low, high = np.quantile(known, [0.002, 0.998]) if len(known) else (0.0, 10.0)
        self._range_m = float(low), float(max(high, low + 5.0))

    def state(self, film: Film, stamp_ns: int) -> tuple[int, ...]:
        """What all looks depend on beside what is wanted: while it is the same, so are they."""
        self.course.seek(film.changes, stamp_ns)
        return self.course.taken, stamp_ns // AGE_STEP_NS

    def look(self, film: Film, stamp_ns: int, wanted: Collection[str]) -> Look:
        """The look at a time; what is dear, TRUTH and WHO, is NaN unless wanted."""
        self.course.seek(film.changes, stamp_ns)
        cells = self.cells()
        age_ns = np.maximum(stamp_ns - stamp_ns % AGE_STEP_NS - self.course.changed_ns, 0)
        age_s = np.where(self.course.changed_ns < 0, np.nan, age_ns * 1e-9)
        return Look(
            top_m(cells), self._prior_m, self.truth_m(stamp_ns) if TRUTH in wanted else self._nothing,
            cells.occupation, cells.by_name["confidence"], age_s.reshape(self._grid.shape),
            self._by(film, stamp_ns) if WHO in wanted else self._nothing, self._range_m,
        )  # fmt: skip

    def _by(self, film: Film, stamp_ns: int) -> F64:
        """Of the registers that there are in the end, whose is the newest that was made by a time."""
        by = np.full(self._grid.size, np.nan)
        registers = film.registers()
        made = registers[registers["tick"].astype(np.int64) * 1_000_000 <= stamp_ns]
        made = made[np.argsort(made["tick"], kind="stable")]
        by[made["cell"]] = made["robot"] - 1.0
        return by.reshape(self._grid.shape)

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
