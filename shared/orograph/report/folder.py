"""Composes the finished run folder from what the services left in OUT/parts, summary.json last.

Every file is written under a temporary name and renamed, so nothing half written bears a finished file's name.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np

from orograph.judge import reference, summary
from orograph.layers import CellMap
from orograph.report import page
from orograph.storage.cache import cache_folder
from orograph.storage.parts import EVENTS, GLRM, REPORT, SUMMARY, read_parts


def compose(out: Path, cache: Path | None = None) -> Path:
    """Make the finished run folder from `out`/parts and give the path of its summary.json; raises FolderError.

    `cache` keeps reference maps, which depend on the scenario alone; None: where this machine keeps such things.
    """
    (out / SUMMARY).unlink(missing_ok=True)
    parts = read_parts(out)
    verdict = summary.judge(parts, reference.cached(parts.scenario, cache or cache_folder()))
    _write(out / EVENTS, "".join(json.dumps(e, sort_keys=True) + "\n" for e in parts.events).encode())
    _write_map(out / GLRM, verdict.glrm)
    for robot, hrm in parts.hrms():
        _write_map(out / f"hrm_{robot}.npz", hrm)
    _write(out / REPORT, page.render(parts, verdict).encode())
    _write(out / SUMMARY, (json.dumps(verdict.summary, indent=2) + "\n").encode())
    return out / SUMMARY


def _write(path: Path, content: bytes) -> None:
    temporary = path.with_name(f".{path.name}.part")
    temporary.write_bytes(content)
    temporary.replace(path)


def _write_map(path: Path, cells: CellMap) -> None:
    temporary = path.with_name(f".{path.name}.part")
    arrays: dict[str, Any] = dict(cells.layers())
    with temporary.open("wb") as stream:
        np.savez_compressed(stream, origin_m=np.array(cells.grid.origin_m), cell_m=cells.grid.cell_m, **arrays)
    temporary.replace(path)
