"""Which reader takes what: formats are recognised by names and first bytes, and a name may overrule that."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

from orograph.importers.scans import kitti, npz, nuscenes, pcd, ply, text
from orograph.importers.scans.bag import BagScans
from orograph.importers.scans.las import LasFile
from orograph.importers.scans.scan import Scan, ScanError, ScanFiles, Scans

FILES: dict[str, Callable[[Path], Scan]] = {
    "kitti": kitti.read, "npz": npz.read, "nuscenes": nuscenes.read, "pcd": pcd.read, "ply": ply.read, "xyz": text.read,
}  # fmt: skip
"""Formats of one scan a file."""
FORMATS = (*FILES, "las", "bag")
SUFFIXES = {
    ".pcd.bin": "nuscenes", ".bin": "kitti", ".pcd": "pcd", ".ply": "ply", ".npz": "npz", ".xyz": "xyz", ".csv": "xyz",
    ".las": "las", ".laz": "las", ".bag": "bag", ".mcap": "bag", ".db3": "bag",
}  # fmt: skip
FIRST_BYTES = {
    b"ply": "ply", b"LASF": "las", b"# .PCD": "pcd", b"VERSION": "pcd", b"PK\x03\x04": "npz", b"#ROSBAG": "bag",
    b"\x89MCAP": "bag", b"SQLite format": "bag",
}  # fmt: skip
BAG_FOLDER = "metadata.yaml"


def open_scans(source: Path, form: str | None = None, topic: str | None = None, in_map: bool | None = None,
               posed: bool = False) -> Scans:  # fmt: skip
    """The scans of a file, a folder of files, or a bag; raises ScanError.

    `in_map` None: as is usual for the format. `posed`: poses come from elsewhere.
    """
    if not source.exists():
        raise ScanError(f"{source}: no such file or folder")
    if form == "bag" or (form is None and (source / BAG_FOLDER).is_file()):
        return BagScans(source, topic, posed)
    files = files_in(source, form)
    form = form or format_of(files[0])
    if form == "bag":
        _alone(files, "a bag is one file, or the folder with its metadata.yaml")
        return BagScans(files[0], topic, posed)
    if form == "las":
        _alone(files, "give several LAS files by name")
        return LasFile(files[0], True if in_map is None else in_map)
    stamps = kitti.stamps_ns(files[0].parent, len(files)) if form == "kitti" and source.is_dir() else None
    return ScanFiles(files, FILES[form], stamps, bool(in_map))


def files_in(source: Path, form: str | None) -> list[Path]:
    """The scan files of a folder in the order of their names, or the file itself; raises ScanError."""
    if source.is_file():
        return [source]
    files = sorted(path for path in source.iterdir() if path.is_file() and not path.name.startswith("."))
    known = [path for path in files if suffix_of(path)]
    kinds = sorted({SUFFIXES[suffix_of(path)] for path in known})
    if form is not None:
        alike = [path for path in known if SUFFIXES[suffix_of(path)] == form]
        known, kinds = alike or known or files, [form]
    if len(kinds) > 1:
        raise ScanError(f"{source}: holds files of {' and '.join(kinds)}; choose by --format")
    if not known:
        inner = next((path for path in ("velodyne_points/data", "velodyne") if (source / path).is_dir()), None)
        if inner:
            return files_in(source / inner, form)
        names = ", ".join(path.name for path in files[:3]) or "nothing"
        raise ScanError(f"{source}: no scans in this folder (it holds {names}); known: {', '.join(SUFFIXES)}")
    return known


def suffix_of(path: Path) -> str:
    """The known ending of a file's name, empty if there is none."""
    return next((suffix for suffix in SUFFIXES if path.name.lower().endswith(suffix)), "")


def format_of(path: Path) -> str:
    """A file's format: by its first bytes, else by its name; raises ScanError."""
    try:
        with path.open("rb") as stream:
            head = stream.read(16)
    except OSError as error:
        raise ScanError(f"{path}: cannot be read ({error.strerror})") from None
    if not head:
        raise ScanError(f"{path}: is empty")
    found = next((name for first, name in FIRST_BYTES.items() if head.startswith(first)), None)
    if found is None and not suffix_of(path):
        raise ScanError(f"{path}: of no format that is known; name it: --format {'|'.join(FORMATS)}")
    return found or SUFFIXES[suffix_of(path)]


def _alone(files: Sequence[Path], cure: str) -> None:
    if len(files) > 1:
        raise ScanError(f"{files[0].parent}: holds {len(files)} such files; {cure}")
