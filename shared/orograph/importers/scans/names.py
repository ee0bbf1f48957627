"""A scan's stamp in the name of its file, as recorders write it."""

from __future__ import annotations

import re
from pathlib import Path

_SECONDS = re.compile(r"(?<!\d)(\d{9,10})[._](\d{3,9})(?!\d)")
_WHOLE = re.compile(r"(?<!\d)(\d{19}|\d{16})(?!\d)")


def stamp_of_name(path: Path) -> int | None:
    """Unix time [ns] from `1532402927647951.bin` (us), 19 digits (ns) or `1532402927.647951.pcd` (s), else None."""
    if found := _SECONDS.search(path.name):
        return int(found[1]) * 10**9 + int(f"{found[2]:0<9}")
    if found := _WHOLE.search(path.name):
        return int(found[1]) * (1000 if len(found[1]) == 16 else 1)
    return None
