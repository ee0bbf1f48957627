"""A map ready to leave the house: its layers, where on Earth they lie, and of when they are."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from orograph.arrays import F32, F64, Mask
from orograph.errors import InputError
from orograph.grid import Grid
from orograph.layers import KINDS, CellMap


@dataclass(frozen=True, eq=False)
class Chart:
    """A map and its place: map frame + `crs_origin_m` is the CRS named, if any."""

    cells: CellMap
    crs: str = ""
    crs_origin_m: tuple[float, float] = (0.0, 0.0)
    stamp_ns: int = 0
    frame: str = "map"

    @property
    def grid(self) -> Grid:
        """The grid in the CRS, or in the map frame where there is none."""
        grid, (x_m, y_m) = self.cells.grid, self.crs_origin_m
        return Grid((grid.origin_m[0] + x_m, grid.origin_m[1] + y_m), grid.cell_m, grid.shape)

    @property
    def known(self) -> Mask:
        """Cells (rows, cols) of which anything is known."""
        told = self.cells.confidence > 0
        return told | (self.cells.by_name["confidence_top"] > 0) if "confidence_top" in self.cells.by_name else told

    def layers(self) -> list[tuple[str, str, F32]]:
        """(name, unit, values (rows, cols)): NaN where nothing is known, but in layers that the scenario gives."""
        unknown = ~self.known
        out = []
        for name, layer in self.cells.layers():
            values = layer.copy()
            if KINDS[name].wire:
                values[unknown] = np.nan
            out.append((name, KINDS[name].unit, values))
        return out

    def centres_m(self) -> tuple[F64, F64]:
        """x and y (rows, cols) of the cells' centres, in the CRS."""
        x, y = self.grid.centres_m()
        return np.broadcast_to(x, self.grid.shape), np.broadcast_to(y[:, None], self.grid.shape)


def known_crs(text: str) -> Any:
    """The CRS that a text names, of pyproj; raises InputError."""
    from pyproj import CRS
    from pyproj.exceptions import CRSError

    try:
        return CRS.from_user_input(text)
    except CRSError:
        raise InputError(f"crs {text[:80]}: unknown to PROJ; name for instance EPSG:32635") from None
