"""XYZ and CSV: a point a line, columns by a header with x, y, z, or the first three."""

from __future__ import annotations

import re
from io import StringIO
from pathlib import Path

import numpy as np

from orograph.importers.scans.fields import beside, scan_of_fields
from orograph.importers.scans.names import stamp_of_name
from orograph.importers.scans.scan import Scan, ScanError


def read(path: Path) -> Scan:
    """One .xyz, .csv or .txt file; raises ScanError."""
    try:
        text = path.read_text(encoding="utf-8-sig")
    except UnicodeDecodeError as error:
        raise ScanError(f"{path}: no text in UTF-8 (byte {error.start}); try another --format") from None
    lines = text.splitlines()
    start = next((i for i, line in enumerate(lines) if line.strip() and line.lstrip()[0] not in "#/"), len(lines))
    if start == len(lines):
        raise ScanError(f"{path}: holds no points")
    split = next((mark for mark in ",;\t" if mark in lines[start]), None)
    first = [word.strip().strip('"') for word in lines[start].split(split)]
    named = not _is_number(first[0])
    names = first if named else ["x", "y", "z", *(f"column_{i}" for i in range(4, len(first) + 1))]
    if not named and len(first) < 3:
        raise ScanError(f"{path}:{start + 1}: expected x y z, found {lines[start][:60]!r}")
    names = [re.sub(r"\W*\[.*\]|^//", "", name).lower() for name in names]
    body = StringIO("\n".join(lines[start + named :]))
    wanted = [names.index(axis) for axis in "xyz"] if set("xyz") <= set(names) else []
    if not wanted:
        raise ScanError(f"{path}:{start + 1}: no columns x, y, z; it has {', '.join(names)[:80]}")
    try:
        rows = np.loadtxt(body, delimiter=split, usecols=wanted, ndmin=2, comments=("#", "//"))
    except ValueError as error:
        raise ScanError(f"{path}: {str(error)[:120]} (counted from line {start + named + 1})") from None
    return scan_of_fields(path, beside(dict(zip("xyz", rows.T, strict=True))), stamp_of_name(path))


def _is_number(word: str) -> bool:
    try:
        float(word)
    except ValueError:
        return False
    return True
