"""The run folder: the name of everything in it, what lies around it, and the one way in which files are written.

Names are relative to it, joined as `out / SUMMARY`. `parts/` is what services leave, the rest is made of that.
"""

from __future__ import annotations

import os
import re
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any, BinaryIO
from zipfile import BadZipFile

import numpy as np
import numpy.typing as npt

from orograph import keys
from orograph.errors import InputError

SUMMARY, REPORT, EVENTS, GLRM = "summary.json", "report.html", "events.jsonl", "glrm.npz"
"""What a finished folder holds; the summary is written last, so that its presence says "finished"."""
MAP, MAP_INFO = "map.npz", "map.json"
"""What a folder holds that was mapped from recordings, beside its report; the second is written last."""
LOGS, STORE = "logs", "map.sqlite"
PARTS = "parts"
SCENARIO, RUN, WORLD = f"{PARTS}/scenario.json", f"{PARTS}/run.json", f"{PARTS}/world.json"
START = f"{PARTS}/start.json"
LATEST, SCHEMA = "latest", "schema"
"""Beside the run folders of a cluster: the name of the newest, and the layout's version."""
STUDY, STUDY_PAGE = "study.json", "study.html"
"""Beside the run folders of a study."""

_NODE = re.compile(r"(?:stages-)?(?P<service>[a-z-]+?)(?:-(?P<robot>robot_[0-9]{3}))?\.[a-z]+")


class FolderError(InputError):
    """A folder that holds no run, or not a whole one; the message says what is missing."""


def hrm_file(robot: str) -> str:
    """A robot's last high-resolution map."""
    return f"hrm_{robot}.npz"


def node_file(node: str) -> str:
    """A node's artifacts."""
    return f"{PARTS}/{node.replace('/', '-')}.npz"


def stages_file(node: str) -> str:
    """A node's stage durations."""
    return f"{PARTS}/stages-{node.replace('/', '-')}.json"


def bytes_file(process: str) -> str:
    """Radio bytes by robot, as one process counted them."""
    return f"{PARTS}/bytes-{process}.json"


def records(out: Path) -> list[Path]:
    """The parts of a run's record, oldest first."""
    return sorted(out.glob("record-[0-9]*.mcap"), key=lambda path: int(path.stem.removeprefix("record-")))


def next_record(out: Path) -> Path:
    """Where the next part of a run's record goes: none is written over."""
    last = int(parts[-1].stem.removeprefix("record-")) if (parts := records(out)) else 0
    return out / f"record-{last + 1:03d}.mcap"


def process_file(process: str) -> str:
    """A process's own figures: its nodes, its memory, its mailbox."""
    return f"{PARTS}/process-{process}.json"


def events_file(process: str) -> str:
    """A process's events, one JSON line each."""
    return f"{PARTS}/events/{process}.jsonl"


def node_of(path: Path) -> str | None:
    """The node whose artifacts or stage durations a file holds; None for a file of another kind."""
    found = _NODE.fullmatch(path.name)
    if found is None or found["service"] not in keys.SERVICES:
        return None
    return keys.node(found["service"], found["robot"])


@contextmanager
def whole_file(path: Path) -> Iterator[BinaryIO]:
    """A new file, in a folder made if need be, that bears its name only when it is complete.

    It is written beside it and renamed, so that whoever finds it can read it.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    part = path.with_name(f".{path.name}.part")
    try:
        with part.open("wb") as stream:
            yield stream
        part.replace(path)
    finally:
        part.unlink(missing_ok=True)


def read_text(out: Path, file: str) -> str:
    """A text file of a run folder; raises FolderError where it is not there."""
    try:
        return (out / file).read_text(encoding="utf-8")
    except OSError as error:
        raise FolderError(f"{out / file} cannot be read ({error.strerror}): is {out} the folder of a run?") from error


def write_whole(path: Path, text: str) -> None:
    """A text file, complete or not there."""
    with whole_file(path) as stream:
        stream.write(text.encode())


def read_arrays(path: Path) -> dict[str, npt.NDArray[Any]]:
    """What `write_arrays` wrote; raises FolderError where it cannot be read."""
    try:
        with path.open("rb") as stream, np.load(stream, allow_pickle=False) as arrays:
            return {name: arrays[name] for name in arrays.files}
    except (OSError, ValueError, EOFError, BadZipFile) as error:
        raise FolderError(f"{path}: cannot be read ({error}): it is cut short or damaged") from error


def write_arrays(path: Path, arrays: Mapping[str, npt.NDArray[Any]]) -> None:
    """A compressed npz file of arrays by name, complete or not there."""
    with whole_file(path) as stream:
        np.savez_compressed(stream, **dict(arrays))  # type: ignore[arg-type]


def new_folder(out: Path | None, stem: str) -> Path:
    """An empty folder, by default the next runs/<stem>-NNN; raises InputError where it can't be had."""
    if out is None:
        out = next_folder(Path("runs"), stem)
    if out.exists() and (not out.is_dir() or any(out.iterdir())):
        raise InputError(f"--out {out}: not an empty folder; name a new one or remove it")
    try:
        out.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(f"--out {out}: cannot be written ({error.strerror})") from None
    return out


def next_folder(runs: Path, stem: str) -> Path:
    """The first of runs/<stem>-001, -002, ... that is not there yet."""
    return next(path for i in range(1, 10_000) if not (path := runs / f"{stem}-{i:03d}").exists())


def cache_folder() -> Path:
    """Where results that can be made again are kept: `$XDG_CACHE_HOME/orograph`, by default `~/.cache/orograph`."""
    base = os.environ.get("XDG_CACHE_HOME", "")
    # The XDG rule: a relative path is invalid and ignored.
    return (Path(base) if base.startswith("/") else Path.home() / ".cache") / "orograph"
