"""The run folder: reads what the services left in OUT/parts and composes the finished folder, summary.json last.

Every file is written under a temporary name and renamed, so nothing half written bears a finished file's name.
"""

from __future__ import annotations

import json
import re
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from orograph import keys
from orograph.edge.cache import cache_folder
from orograph.layers import CellMap
from orograph.report import page, reference, summary
from orograph.report.parts import Arrays, RunParts
from orograph.scenario import Scenario

PARTS, SUMMARY, REPORT, EVENTS, GLRM = "parts", "summary.json", "report.html", "events.jsonl", "glrm.npz"
NODE_FILE = re.compile(r"(?P<service>[a-z-]+?)(?:-(?P<robot>robot_[0-9]{3}))?")


class FolderError(ValueError):
    """A folder that holds no run; the message says what is missing."""


def read_parts(out: Path) -> RunParts:
    """What a run left in `out`/parts; raises FolderError when the run or its scenario cannot be read."""
    parts = out / PARTS
    up, down = _bytes(parts)
    return RunParts(
        scenario=Scenario.model_validate_json(_text(parts / "scenario.json")),
        run=json.loads(_text(parts / "run.json")),
        nodes=dict(_node_arrays(parts)),
        stages_ns=dict(_stages(parts)),
        bytes_up=up,
        bytes_down=down,
        events=_events(parts / "events"),
    )


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


def _text(path: Path) -> str:
    try:
        return path.read_text(encoding="utf-8")
    except OSError as error:
        raise FolderError(
            f"{path} cannot be read ({error.strerror}): is {path.parent.parent} the folder of a run?"
        ) from error


def _node_name(stem: str) -> str | None:
    found = NODE_FILE.fullmatch(stem)
    if found is None or found["service"] not in keys.SERVICES:
        return None
    return keys.node(found["service"], found["robot"])


def _node_arrays(parts: Path) -> Iterator[tuple[str, Arrays]]:
    for path in sorted(parts.glob("*.npz")):
        name = _node_name(path.stem)
        if name is not None:
            with np.load(path, allow_pickle=False) as arrays:
                yield name, {key: arrays[key] for key in arrays.files}


def _stages(parts: Path) -> Iterator[tuple[str, dict[str, Any]]]:
    for path in sorted(parts.glob("stages-*.json")):
        name = _node_name(path.stem.removeprefix("stages-").rstrip("-"))
        if name is not None:
            yield name, {s: np.array(ns, np.int64) for s, ns in json.loads(_text(path)).items()}


def _bytes(parts: Path) -> tuple[dict[str, int], dict[str, int]]:
    total: dict[str, dict[str, int]] = {"up": {}, "down": {}}
    for path in sorted(parts.glob("bytes-*.json")):
        counted: Mapping[str, Mapping[str, int]] = json.loads(_text(path))
        for way, sums in total.items():
            for robot, n in counted.get(way, {}).items():
                sums[robot] = sums.get(robot, 0) + int(n)
    return total["up"], total["down"]


def _events(folder: Path) -> tuple[Mapping[str, Any], ...]:
    lines = [line for path in sorted(folder.glob("*.jsonl")) for line in _text(path).splitlines()]
    return tuple(sorted((e for e in map(_event, lines) if e is not None), key=lambda e: int(e.get("stamp_ns", 0))))


def _event(line: str) -> Mapping[str, Any] | None:
    """One event; None for a line cut short by a service's death."""
    try:
        event = json.loads(line)
    except json.JSONDecodeError:
        return None
    return event if isinstance(event, dict) else None


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
