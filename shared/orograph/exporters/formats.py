"""Which formats there are, and one map written in some of them, each file whole or not there."""

from __future__ import annotations

import shutil
import tempfile
from collections.abc import Callable, Iterable, Iterator, Sequence
from pathlib import Path
from typing import TypeVar

from orograph.errors import InputError
from orograph.exporters import geotiff, las, mesh, nav2, npz, ros
from orograph.exporters.chart import Chart

Written = TypeVar("Written")
STILL: dict[str, tuple[str, Callable[[Path, Chart], None]]] = {
    "geotiff": (".tif", geotiff.write), "cog": (".cog.tif", geotiff.write_cog), "pgm": (".pgm", nav2.write),
    "npz": (".npz", npz.write), "ply": (".ply", mesh.write_ply), "glb": (".glb", mesh.write_glb),
    "las": (".las", las.write), "laz": (".laz", las.write),
}  # fmt: skip
"""Formats of one map a file: the file's ending and who writes it."""
MOVING: dict[str, tuple[str, Callable[[Path, Sequence[Chart]], None]]] = {
    "rosbag2": (".rosbag2", ros.write_folder), "mcap": (".mcap", ros.write_mcap),
}  # fmt: skip
"""Formats of which a file holds a map at many times."""
FORMATS = (*STILL, *MOVING)


def export(charts: Sequence[Chart], name: str, formats: Iterable[str], out: Path) -> Iterator[Path]:
    """Write a map at its times as `out`/`name` with each format's ending, in place of what was there.

    Gives what it wrote; of several times, files of one map a file have them in their names. Raises InputError where it
    cannot be written.
    """
    try:
        out.mkdir(parents=True, exist_ok=True)
        for form in formats:
            if form in MOVING:
                ending, write_all = MOVING[form]
                yield from _whole(out, f"{name}{ending}", write_all, charts)
                continue
            ending, write = STILL[form]
            for chart in charts:
                at = f"_{chart.stamp_ns // 10**6:07d}ms" if len(charts) > 1 else ""
                yield from _whole(out, f"{name}{at}{ending}", write, chart)
    except OSError as error:
        raise InputError(f"--out {out}: cannot be written ({error.strerror or error})") from None


def _whole(out: Path, name: str, write: Callable[[Path, Written], None], what: Written) -> Iterator[Path]:
    """What `write` makes of `name`, moved to `out` once it is complete."""
    with tempfile.TemporaryDirectory(dir=out, prefix=".part-") as scratch:
        write(Path(scratch) / name, what)
        for made in sorted(Path(scratch).iterdir()):
            there = out / made.name
            if there.is_dir():
                shutil.rmtree(there)
            yield made.replace(there)
