"""What a cell holds, said once in a table, and the map that holds it (mapping.md section 1).

Map layers, registers on the wire, their hashes and the columns of the kernels all follow from the table: a new layer
is a row here and the kernel that computes it.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np
import numpy.typing as npt

from orograph.grid import Grid

Layer = npt.NDArray[np.float32]

UNKNOWN_HEIGHT: Final = -(2**31)
UNKNOWN_GRADIENT: Final = -32768
UNKNOWN_OCCUPATION: Final = 255
OCCUPATION_ONE: Final = 254
SHARE_ONE: Final = 200


@dataclass(frozen=True)
class LayerKind:
    """One row: `blank` is the value of a cell of which nothing is known; the rest says how a register carries it."""

    name: str
    unit: str
    blank: float = math.nan
    wire: str = ""
    """Type of the whole number in a register; empty for what the scenario gives, or the map manager keeps beside it."""
    step: float = 1.0
    """What one of these whole numbers stands for [unit]."""
    lowest: int = 0
    highest: int = 255
    unknown: int | None = None
    """The whole number that stands for NaN; None where there is always a value."""
    moved: float = math.inf
    """A register is worth sending when this layer moved by more than so many steps (mapping.md section 4)."""
    fused: str = "given"
    """How two cells become one (mapping.md section 3), in words."""
    basic: bool = True
    """Every map has it; the others only where somebody adds them by name."""


TABLE: Final = (
    LayerKind("gps_quality", "0 none, 1 single, 2 differential", 0.0),
    LayerKind("communications", "0 none, 1 available", 1.0),
    LayerKind(
        "height", "m", wire="<i4", step=1e-3, lowest=1 - 2**31, highest=2**31 - 1, unknown=UNKNOWN_HEIGHT, moved=100,
        fused="mean",
    ),
    LayerKind(
        "gradient_x", "m/m", wire="<i2", step=1e-4, lowest=-32767, highest=32767, unknown=UNKNOWN_GRADIENT,
        fused="mean of what is known",
    ),
    LayerKind(
        "gradient_y", "m/m", wire="<i2", step=1e-4, lowest=-32767, highest=32767, unknown=UNKNOWN_GRADIENT,
        fused="mean of what is known",
    ),
    LayerKind(
        "occupation", "0..1", wire="u1", step=1 / OCCUPATION_ONE, highest=OCCUPATION_ONE, unknown=UNKNOWN_OCCUPATION,
        moved=0.1 * OCCUPATION_ONE, fused="from the fused gradients; at map level mean of what is known",
    ),
    LayerKind("confidence", "0..255", 0.0, wire="u1", lowest=1, moved=16, fused="sum, at most 255"),
    LayerKind(
        "height_top", "m", wire="<i4", step=1e-3, lowest=1 - 2**31, highest=2**31 - 1, unknown=UNKNOWN_HEIGHT,
        moved=250, fused="the higher", basic=False,
    ),
    LayerKind("confidence_top", "0..255", 0.0, wire="u1", lowest=1, moved=16, fused="sum, at most 255", basic=False),
    LayerKind(
        "wall_share", "0..1", 0.0, wire="u1", step=1 / SHARE_ONE, highest=SHARE_ONE, moved=0.1 * SHARE_ONE,
        fused="mean", basic=False,
    ),
    LayerKind(
        "free_share", "0..1", 0.0, wire="u1", step=1 / SHARE_ONE, highest=SHARE_ONE, moved=0.1 * SHARE_ONE,
        fused="mean", basic=False,
    ),
    LayerKind("changed_at", "s of simulation time", fused="kept beside the map", basic=False),
)  # fmt: skip


def holds_nothing(kind: LayerKind, values: Layer) -> bool:
    """Whether values of a layer are all as where nothing is known."""
    return bool(np.isnan(values).all() if math.isnan(kind.blank) else (values == kind.blank).all())


KINDS: Final = {kind.name: kind for kind in TABLE}
LAYERS: Final = tuple(kind.name for kind in TABLE if kind.basic)
MAPPED: Final = tuple(kind for kind in TABLE if kind.wire)
"""What mapping finds out, in the order of a cell's values in kernels, registers and hashes."""
MAPPED_LAYERS: Final = tuple(kind.name for kind in MAPPED)
BASIC_LAYERS: Final = tuple(kind.name for kind in MAPPED if kind.basic)
WIDTH: Final = len(MAPPED)
HEIGHT: Final = MAPPED_LAYERS.index("height")
GRADIENT_X: Final = MAPPED_LAYERS.index("gradient_x")
GRADIENT_Y: Final = MAPPED_LAYERS.index("gradient_y")
OCCUPATION: Final = MAPPED_LAYERS.index("occupation")
CONFIDENCE: Final = MAPPED_LAYERS.index("confidence")
HEIGHT_TOP: Final = MAPPED_LAYERS.index("height_top")
CONFIDENCE_TOP: Final = MAPPED_LAYERS.index("confidence_top")
WALL_SHARE: Final = MAPPED_LAYERS.index("wall_share")
FREE_SHARE: Final = MAPPED_LAYERS.index("free_share")
CONFIDENCE_MAX = 255.0
OCCUPIED = 0.5
"""A cell counts as occupied from this occupation on: half of the largest passable slope. A GLRM cell mixes wall and
street, so its mean seldom reaches 1; below 0.5 the robot drives."""
CONFIDENT = 64.0
"""A cell counts as mapped from this confidence on (mapping.md section 6, "mapping time")."""


@dataclass(frozen=True, eq=False)
class CellMap:
    """Float32 layers (rows, cols) by name over one grid; NaN is unknown, confidence 0 means nothing known.

    Every basic layer is there, others of the table may be; `cell_map.height` is `cell_map.by_name["height"]`.
    """

    grid: Grid
    by_name: Mapping[str, Layer]

    def __post_init__(self) -> None:
        assert set(LAYERS) <= set(self.by_name) <= set(KINDS), sorted(self.by_name)
        for name, layer in self.layers():
            assert layer.dtype == np.float32 and layer.shape == self.grid.shape, (name, layer.dtype, layer.shape)

    def __getattr__(self, name: str) -> Layer:
        if name in KINDS and name in self.by_name:
            return self.by_name[name]
        raise AttributeError(f"this map has no layer {name}")

    @classmethod
    def unknown(cls, grid: Grid) -> CellMap:
        """A map of nothing: NaN values, confidence 0, no GPS, communications available."""
        return cls(grid, {name: np.full(grid.shape, KINDS[name].blank, np.float32) for name in LAYERS})

    def layers(self) -> Iterator[tuple[str, Layer]]:
        """Pairs (name, array) in the order of the table."""
        for name in KINDS:
            if name in self.by_name:
                yield name, self.by_name[name]

    @property
    def known(self) -> npt.NDArray[np.bool_]:
        """Cells with any confidence (rows, cols)."""
        return self.confidence > 0

    @property
    def visible(self) -> Layer:
        """The surface (rows, cols) [m] that is seen from above: the top where something bars the cell, else ground."""
        stands: npt.NDArray[np.bool_] = np.nan_to_num(self.occupation) >= OCCUPIED
        return np.where(stands, self.tops, self.height)

    @property
    def tops(self) -> Layer:
        """The upper surface (rows, cols) [m]: `height_top` where the map has that layer and knows it, else `height`."""
        top = self.by_name.get("height_top", self.height)
        return np.where(np.isfinite(top), top, self.height)

    def copy(self) -> CellMap:
        """A deep copy over the same grid."""
        return CellMap(self.grid, {name: layer.copy() for name, layer in self.layers()})

    def equals(self, other: CellMap) -> bool:
        """Same grid, the same layers and the same values, NaN equal to NaN."""
        mine, theirs = dict(self.layers()), dict(other.layers())
        same = self.grid == other.grid and mine.keys() == theirs.keys()
        return same and all(np.array_equal(mine[name], theirs[name], equal_nan=True) for name in mine)
