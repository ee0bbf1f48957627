"""What the Map Manager checks of a well-formed message (faults.md, "Payload validation")."""

from __future__ import annotations

import numpy as np

from orograph.layers import UNKNOWN_HEIGHT
from orograph.messages import UPDATE, Batch, CellsRequest, Hello, Packed
from orograph.registers import has_evidence

HEIGHT_MAX_MM = 10_000_000
FUTURE_MS = 1_000
BATCH_RECORDS_MAX = 256
NONCE_BYTES = 16


def records_fault(records: Packed, size: int, now_ns: int) -> str | None:
    """Why these records of a batch cannot be taken, in one word, or None."""
    if records.dtype != UPDATE or records.ndim != 1 or not 1 <= len(records) <= BATCH_RECORDS_MAX:
        return "shape"
    if (records["cell"] >= size).any():
        return "cell-range"
    if len(np.unique(records["cell"])) != len(records):
        return "duplicate-cell"
    if (~has_evidence(records)).any() or (records["seq"] == 0).any():
        return "no-evidence"
    for height, confidence in (("height", "confidence"), ("height_top", "confidence_top")):
        known = (records[height] != UNKNOWN_HEIGHT) | (records[confidence] > 0)
        if (np.abs(records[height][known].astype(np.int64)) > HEIGHT_MAX_MM).any():
            return "height-range"
    if (records["tick"].astype(np.int64) > now_ns // 1_000_000 + FUTURE_MS).any():
        return "future-tick"
    return None


def fault(message: object, size: int, tiles: int, now_ns: int) -> str | None:
    """Why this message from a robot cannot be taken, in one word, or None; epochs and seqs are judged elsewhere."""
    if isinstance(message, Batch):
        return records_fault(message.records, size, now_ns)
    if isinstance(message, Hello):
        return None if len(message.nonce) == NONCE_BYTES else "nonce"
    if isinstance(message, CellsRequest):
        return "tile-range" if (message.tiles >= tiles).any() else None
    return "unexpected"
