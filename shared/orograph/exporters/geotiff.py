"""GeoTIFF and cloud-optimised GeoTIFF: a band a layer, north up, NaN for what is not known."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from orograph.exporters.chart import Chart, known_crs


def write(path: Path, chart: Chart) -> None:
    """One GeoTIFF; raises InputError for a CRS that nobody knows."""
    _write(path, chart, {"driver": "GTiff", "compress": "deflate", "tiled": True})


def write_cog(path: Path, chart: Chart) -> None:
    """The same with overviews and tiles in the order that web readers want."""
    _write(path, chart, {"driver": "COG", "compress": "deflate", "overview_resampling": "average"})


def _write(path: Path, chart: Chart, options: dict[str, Any]) -> None:
    import rasterio

    grid, layers = chart.grid, chart.layers()
    left_m, _, _, top_m = grid.extent_m
    crs = rasterio.crs.CRS.from_wkt(known_crs(chart.crs).to_wkt()) if chart.crs else None
    with rasterio.open(
        path, "w", width=grid.cols, height=grid.rows, count=len(layers), dtype="float32", nodata=np.nan, crs=crs,
        transform=rasterio.Affine(grid.cell_m, 0.0, left_m, 0.0, -grid.cell_m, top_m), **options,
    ) as file:  # fmt: skip
        for band, (name, unit, values) in enumerate(layers, 1):
            file.write(values[::-1], band)
            file.set_band_description(band, name)
            file.set_band_unit(band, unit)
