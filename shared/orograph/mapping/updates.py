"""Which registers are worth sending: the UpdatedCellsList's thresholds (mapping.md section 4), in register units."""

from __future__ import annotations

import numpy as np

from orograph.arrays import Mask
from orograph.layers import MAPPED
from orograph.messages import Packed
from orograph.register_kernels import moved_enough
from orograph.registers import UNKNOWN

_MOVED = np.array([kind.moved for kind in MAPPED])


def moved(new: Packed, held: Packed) -> Mask:
    """Which registers `new` (n,) say something of first sight, or away from what is held by more than a threshold.

    `held` (cells,) are the registers of all cells, confidence 0 for none. To become known or unknown is to move.
    """
    mask: Mask = moved_enough(new, held, _MOVED, UNKNOWN)
    return mask
