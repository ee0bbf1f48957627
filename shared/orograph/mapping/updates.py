"""Which registers are worth sending: the UpdatedCellsList's thresholds (mapping.md section 4), in register units."""

from __future__ import annotations

import numpy as np

from orograph.arrays import Mask
from orograph.layers import MAPPED
from orograph.messages import Packed
from orograph.register_kernels import moved_enough
from orograph.registers import UNKNOWN, has_evidence, numbers

_MOVED = np.array([kind.moved for kind in MAPPED])


def moved(new: Packed, held: Packed) -> Mask:
    """Which registers `new` (n,) are of first sight, or away from those held (n,) by more than a layer's threshold.

    To become known or unknown is to move.
    """
    here, there = numbers(new), numbers(held)
    far: Mask = moved_enough(here, there, _MOVED, UNKNOWN)
    return far | ~has_evidence(held)
