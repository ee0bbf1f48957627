"""LAS and LAZ: a point a known cell, of the ground and of what stands on it, with confidence and occupation."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from orograph.exporters.chart import Chart, known_crs

GROUND, STANDING = 2, 1
"""The ASPRS classes `ground` and `unclassified`."""
STEP_M = 1e-3


def write(path: Path, chart: Chart) -> None:
    """LAS 1.4, point format 6; LAZ where the name says so. Raises InputError for a CRS that nobody knows."""
    import laspy

    header = laspy.LasHeader(point_format=6, version="1.4")
    header.scales, header.offsets = np.full(3, STEP_M), np.array([*np.floor(chart.grid.origin_m), 0.0])
    header.add_extra_dims([laspy.ExtraBytesParams("confidence", "u1"), laspy.ExtraBytesParams("occupation", "f4")])
    if chart.crs:
        header.add_crs(known_crs(chart.crs))
    file = laspy.LasData(header)
    x, y = chart.centres_m()
    layers = chart.cells.by_name
    surfaces = [("height", "confidence", GROUND), ("height_top", "confidence_top", STANDING)]
    found = [(chart.known & np.isfinite(layers[z]), z, sure, kind) for z, sure, kind in surfaces if z in layers]
    file.x = np.concatenate([x[told] for told, _, _, _ in found])
    file.y = np.concatenate([y[told] for told, _, _, _ in found])
    file.z = np.concatenate([layers[z][told].astype(np.float64) for told, z, _, _ in found])
    file.classification = np.concatenate([np.full(told.sum(), kind, np.uint8) for told, _, _, kind in found])
    file.confidence = np.concatenate([layers[sure][told].round().astype(np.uint8) for told, _, sure, _ in found])
    file.occupation = np.concatenate([chart.cells.occupation[told] for told, _, _, _ in found])
    with path.open("wb") as stream:
        file.write(stream, do_compress=path.suffix == ".laz")
