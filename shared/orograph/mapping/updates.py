"""Which registers are worth sending: the UpdatedCellsList's thresholds (mapping.md section 4), in register units."""

from __future__ import annotations

import numpy as np

from orograph.mapping.register_kernels import moved_enough
from orograph.messages import UPDATE, Packed

VALUE_FIELDS = ("tick", "height", "gradient_x", "gradient_y", "occupation", "confidence")


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
        """Those of first sight, or moved from what is held: height > 0.1 m, occupation > 0.1, confidence > 16."""
        return np.compress(moved_enough(records, self._records), records)

    def differing(self, records: Packed) -> Packed:
        """Those that differ at all, tick included, from what is held."""
        held = self._records[records["cell"]]
        return np.compress(np.any([records[name] != held[name] for name in VALUE_FIELDS], axis=0), records)
