"""Arrays over a window that moves with the robot."""

from __future__ import annotations

from typing import Any

import numpy.typing as npt


def roll_into(out: npt.NDArray[Any], layer: npt.NDArray[Any], moved: tuple[int, int]) -> None:
    """Copy what stays of `layer` (rows, cols, ...) after its window moved by `moved` (rows, cols) into `out`.

    The rest of `out`, which has entered, is left as it is.
    """
    (to_rows, from_rows), (to_cols, from_cols) = (
        _overlap(by, size) for by, size in zip(moved, layer.shape, strict=False)
    )
    out[to_rows, to_cols] = layer[from_rows, from_cols]


def _overlap(moved: int, size: int) -> tuple[slice, slice]:
    """Along one axis: where the kept part stands after a move by `moved`, and where it stood before."""
    kept = max(0, size - abs(moved))
    to, source = min(size, max(0, -moved)), min(size, max(0, moved))
    return slice(to, to + kept), slice(source, source + kept)
