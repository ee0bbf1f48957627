"""Short names for the element types of arrays; shapes stand in each function's docstring."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

F32 = npt.NDArray[np.float32]
F64 = npt.NDArray[np.float64]
I32 = npt.NDArray[np.int32]
I64 = npt.NDArray[np.int64]
U1 = npt.NDArray[np.uint8]
Mask = npt.NDArray[np.bool_]
