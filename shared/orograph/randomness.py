"""Random streams that depend on (seed, names, frame) alone, so message order and process layout never matter."""

from __future__ import annotations

import hashlib

import numpy as np


def stream(seed: int, *names: str, frame: int = 0) -> np.random.Generator:
    """A generator of its own for each (seed, names, frame), equal on every host."""
    digest = hashlib.blake2b("/".join((str(seed), *names)).encode(), digest_size=16).digest()
    key = np.frombuffer(digest, "<u8").astype(np.uint64)
    return np.random.Generator(np.random.Philox(key=key, counter=[0, 0, 0, frame]))


def key(seed: int, *names: str, frame: int = 0) -> np.uint64:
    """A 64-bit number of its own for each (seed, names, frame), equal on every host, to draw from."""
    digest = hashlib.blake2b("/".join((str(seed), *names, str(frame))).encode(), digest_size=8).digest()
    return np.uint64(int.from_bytes(digest, "little"))
