"""NPZ: every layer as it is, with its place."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from orograph.exporters.chart import Chart


def write(path: Path, chart: Chart) -> None:
    """`origin_m` (2,) in the CRS, `cell_m`, `crs`, and a float32 array (rows, cols) a layer; rows grow north."""
    grid = chart.grid
    place = {"origin_m": np.array(grid.origin_m), "cell_m": np.array(grid.cell_m), "crs": np.array(chart.crs)}
    with path.open("wb") as stream:
        np.savez_compressed(stream, **place, **{name: values for name, _, values in chart.layers()})  # type: ignore[arg-type]
