"""Which registers are worth sending: the UpdatedCellsList's thresholds (mapping.md section 4), in register units."""

from __future__ import annotations

import numpy as np

from orograph.arrays import Mask
from orograph.layers import CONFIDENCE, MAPPED, MAPPED_LAYERS
from orograph.messages import UPDATE, Packed
from orograph.register_kernels import moved_enough
from orograph.registers import UNKNOWN, numbers

VALUE_FIELDS = ("tick", *MAPPED_LAYERS)
_MOVED = np.array([kind.moved for kind in MAPPED])


def moved(new: Packed, held: Packed) -> Mask:
    """Which registers `new` (n,) are of first sight, or away from those held (n,) by more than a layer's threshold.

    To become known or unknown is to move.
    """
    here, there = numbers(new), numbers(held)
    far: Mask = moved_enough(here, there, _MOVED, UNKNOWN)
    first: Mask = there[:, CONFIDENCE] == 0
    return far | first


class Held:
    """The last register per GLRM cell that someone else holds; confidence 0 where it holds none."""

    def __init__(self, cells: int) -> None:
        self._records = np.zeros(cells, UPDATE)

    def hold(self, records: Packed) -> None:
        """These registers (UPDATE) are held now."""
        self._records[records["cell"]] = records

    def registers(self) -> Packed:
        """What is held, ascending cells."""
        return np.compress(self._records["confidence"] > 0, self._records)

    def moved(self, records: Packed) -> Packed:
        """Those of first sight, or moved from what is held."""
        return np.compress(moved(records, self._records[records["cell"]]), records)

    def differing(self, records: Packed) -> Packed:
        """Those that differ at all, tick included, from what is held."""
        held = self._records[records["cell"]]
        return np.compress(np.any([records[name] != held[name] for name in VALUE_FIELDS], axis=0), records)
