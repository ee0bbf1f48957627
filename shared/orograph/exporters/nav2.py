"""A picture and its YAML as ROS's map servers load them: occupied, free, unknown."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import yaml

from orograph.arrays import U1
from orograph.exporters.chart import Chart

OCCUPIED, FREE, UNKNOWN = 0, 254, 205
THRESHOLDS = {"occupied_thresh": 0.65, "free_thresh": 0.196}
"""Of 1 - grey / 255: the map servers of ROS 1 and 2 take 205 for unknown with these, and with no larger second."""
BARRED = 0.5
"""Occupation from which on a cell is barred."""


def pixels(chart: Chart) -> U1:
    """Grey values (rows, cols), first row north."""
    occupation = chart.cells.occupation
    grey = np.where(occupation >= BARRED, OCCUPIED, FREE).astype(np.uint8)
    grey[~(chart.known & np.isfinite(occupation))] = UNKNOWN
    return grey[::-1]


def write(path: Path, chart: Chart) -> None:
    """`path` (.pgm), and the .yaml beside it that names it."""
    grid = chart.grid
    path.write_bytes(f"P5\n{grid.cols} {grid.rows}\n255\n".encode() + pixels(chart).tobytes())
    told = {
        "image": path.name, "mode": "trinary", "resolution": grid.cell_m, "origin": [*grid.origin_m, 0.0],
        "negate": 0, **THRESHOLDS,
    }  # fmt: skip
    path.with_suffix(".yaml").write_text(yaml.safe_dump(told, sort_keys=False))
