"""Mapping time over the same cells for every number of robots, so that Table 3 compares like with like."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from orograph.judge import reference
from orograph.judge.score import mapping_times_s
from orograph.judge.summary import first_confident_ns
from orograph.storage.parts import read_parts
from orograph.storage.run_folder import cache_folder


def same_cells_times_s(folders: Sequence[Path], cache: Path | None = None) -> dict[int, float | None]:
    """Number of robots -> 95 % mapping time [s] over the cells that the fewest robots' patrol shows.

    Between the shares of several robots lie streets that nobody drives, so each run's own set is smaller and would
    flatter more robots. Raises FolderError where a folder holds no run.
    """
    runs = sorted((read_parts(folder) for folder in folders), key=lambda parts: parts.scenario.robots)
    observable = reference.cached(runs[0].scenario, cache or cache_folder()).observable
    return {parts.scenario.robots: mapping_times_s(first_confident_ns(parts), observable)[95] for parts in runs}
