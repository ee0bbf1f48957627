"""Microseconds to fold one GLRM cell of the default map (200 x 200 cells), with 3 contributors and with 100."""

from __future__ import annotations

import time

import numpy as np
from orograph.messages import REGISTER, UPDATE, Packed
from orograph.protocol.fold import fold
from orograph.rules import PAPER, SURFACE, Rules

CELLS = 40_000
ROUNDS = 15


def contributions(robots: int) -> tuple[Packed, Packed]:
    """A prior (cells,) and registers (robots, cells), half of them similar enough to be averaged."""
    rng, shape = np.random.default_rng(1), (robots, CELLS)
    prior, rows = np.zeros(CELLS, UPDATE), np.zeros(shape, REGISTER)
    prior["cell"], prior["confidence"] = np.arange(CELLS), 32
    rows["height"], rows["tick"] = rng.integers(0, 2_000, shape), rng.integers(0, 300_000, shape)
    rows["gradient_x"], rows["gradient_y"] = rng.integers(-900, 900, (2, *shape))
    rows["occupation"], rows["confidence"] = rng.integers(0, 255, shape), rng.integers(1, 256, shape)
    return prior, rows


def fold_us(robots: int, rules: Rules = SURFACE) -> float:
    """Median microseconds of the thread's processor time per cell over the rounds."""
    prior, rows = contributions(robots)
    fold(prior, rows, rules)
    durations = []
    for _ in range(ROUNDS):
        begin = time.thread_time()
        fold(prior, rows, rules)
        durations.append(time.thread_time() - begin)
    return float(np.median(durations)) / CELLS * 1e6


def figures() -> dict[str, float]:
    """`fold_us`: with 3 contributors, as the record table has it; with 100; by the rules of the paper."""
    return {"fold_us": fold_us(3), "fold_100_us": fold_us(100), "fold_paper_us": fold_us(3, PAPER)}


if __name__ == "__main__":
    for name, value in figures().items():
        print(f"{name:12s} {value:8.3f}")
