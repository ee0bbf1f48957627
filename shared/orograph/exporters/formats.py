"""Which formats there are, and one map written in some of them, each file whole or not there."""

from __future__ import annotations

import shutil
import tempfile
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path

from orograph.errors import InputError
from orograph.exporters import geotiff, las, mesh, nav2, npz, ros
from orograph.exporters.chart import Chart

FORMATS: dict[str, tuple[str, Callable[[Path, Chart], None]]] = {
    "geotiff": (".tif", geotiff.write), "cog": (".cog.tif", geotiff.write_cog), "pgm": (".pgm", nav2.write),
    "npz": (".npz", npz.write), "ply": (".ply", mesh.write_ply), "glb": (".glb", mesh.write_glb),
    "las": (".las", las.write), "laz": (".laz", las.write), "rosbag2": (".rosbag2", ros.write_folder),
    "mcap": (".mcap", ros.write_mcap),
}  # fmt: skip
"""Ending of the file and who writes it."""


def export(chart: Chart, name: str, formats: Iterable[str], out: Path) -> Iterator[Path]:
    """Write the map as `out`/`name` with each format's ending, in place of what was there; gives what it wrote.

    Raises InputError where it cannot be written.
    """
    try:
        out.mkdir(parents=True, exist_ok=True)
        for form in formats:
            ending, write = FORMATS[form]
            with tempfile.TemporaryDirectory(dir=out, prefix=".part-") as scratch:
                write(Path(scratch) / f"{name}{ending}", chart)
                for made in sorted(Path(scratch).iterdir()):
                    there = out / made.name
                    if there.is_dir():
                        shutil.rmtree(there)
                    yield made.replace(there)
    except OSError as error:
        raise InputError(f"--out {out}: cannot be written ({error.strerror or error})") from None
