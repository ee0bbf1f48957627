"""Which registers are worth sending: the UpdatedCellsList's thresholds (mapping.md section 4), in register units."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from orograph.messages import OCCUPATION_ONE, RECORD, UNKNOWN_OCCUPATION, Packed

HEIGHT_MOVED_MM = 100
OCCUPATION_MOVED = 0.1
CONFIDENCE_MOVED = 16
VALUE_FIELDS = ("tick", "height", "gradient_x", "gradient_y", "occupation", "confidence")


class Held:
    """The last register per GLRM cell that someone else holds; confidence 0 where it holds none."""

    def __init__(self, cells: int) -> None:
        self._records = np.zeros(cells, RECORD)

    def hold(self, records: Packed) -> None:
        """These registers (RECORD) are held now."""
        self._records[records["cell"]] = records

    def moved(self, records: Packed) -> Packed:
        """Those of first sight, or moved from what is held: height > 0.1 m, occupation > 0.1, confidence > 16."""
        held = self._records[records["cell"]]
        new_occupation, old_occupation = _whole(records, "occupation"), _whole(held, "occupation")
        became_known = (new_occupation == UNKNOWN_OCCUPATION) != (old_occupation == UNKNOWN_OCCUPATION)
        moved = (
            (held["confidence"] == 0)
            | (np.abs(_whole(records, "height") - _whole(held, "height")) > HEIGHT_MOVED_MM)
            | (np.abs(new_occupation - old_occupation) > OCCUPATION_MOVED * OCCUPATION_ONE)
            | became_known
            | (np.abs(_whole(records, "confidence") - _whole(held, "confidence")) > CONFIDENCE_MOVED)
        )
        return np.compress(moved, records)

    def differing(self, records: Packed) -> Packed:
        """Those that differ at all, tick included, from what is held."""
        held = self._records[records["cell"]]
        return np.compress(np.any([records[name] != held[name] for name in VALUE_FIELDS], axis=0), records)


def _whole(records: Packed, name: str) -> npt.NDArray[np.int64]:
    return records[name].astype(np.int64)
