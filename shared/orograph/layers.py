"""The layered cell map: one type for GLRM, HRM, 3DLaserAuxMap and LLRM (mapping.md section 1)."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from orograph.grid import Grid

Layer = npt.NDArray[np.float32]

GIVEN_LAYERS = ("gps_quality", "communications")
MAPPED_LAYERS = ("height", "gradient_x", "gradient_y", "occupation", "confidence")
LAYERS = GIVEN_LAYERS + MAPPED_LAYERS
UNITS = {
    "gps_quality": "0 none, 1 single, 2 differential",
    "communications": "0 none, 1 available",
    "height": "m",
    "gradient_x": "m/m",
    "gradient_y": "m/m",
    "occupation": "0..1",
    "confidence": "0..255",
}
CONFIDENCE_MAX = 255.0
CONFIDENT = 64.0
"""A cell counts as mapped from this confidence on (mapping.md section 6, "mapping time")."""


@dataclass(frozen=True, eq=False)
class CellMap:
    """Seven float32 layers (rows, cols) over one grid; NaN is unknown, confidence 0 means nothing known."""

    grid: Grid
    gps_quality: Layer
    communications: Layer
    height: Layer
    gradient_x: Layer
    gradient_y: Layer
    occupation: Layer
    confidence: Layer

    def __post_init__(self) -> None:
        for name, layer in self.layers():
            assert layer.dtype == np.float32 and layer.shape == self.grid.shape, (name, layer.dtype, layer.shape)

    @classmethod
    def unknown(cls, grid: Grid) -> CellMap:
        """A map of nothing: NaN values, confidence 0, no GPS, communications available."""
        start = {"communications": 1.0, "gps_quality": 0.0, "confidence": 0.0}
        return cls(grid, **{name: np.full(grid.shape, start.get(name, np.nan), np.float32) for name in LAYERS})

    def layers(self) -> Iterator[tuple[str, Layer]]:
        """Pairs (name, array) in the order of mapping.md."""
        for name in LAYERS:
            yield name, getattr(self, name)

    @property
    def known(self) -> npt.NDArray[np.bool_]:
        """Cells with any confidence (rows, cols)."""
        return self.confidence > 0

    def copy(self) -> CellMap:
        """A deep copy over the same grid."""
        return CellMap(self.grid, *(layer.copy() for _, layer in self.layers()))

    def equals(self, other: CellMap) -> bool:
        """Same grid and the same values, NaN equal to NaN."""
        pairs = zip(self.layers(), other.layers(), strict=True)
        return self.grid == other.grid and all(np.array_equal(a, b, equal_nan=True) for (_, a), (_, b) in pairs)
