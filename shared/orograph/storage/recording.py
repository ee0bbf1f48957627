"""What a process leaves in the run folder: its events while it runs, its nodes' arrays and stage times at the end."""

from __future__ import annotations

import errno
import json
import logging
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from orograph.keys import split
from orograph.node import Node
from orograph.stages import StageRecorder

log = logging.getLogger("orograph.recording")


def _write_whole(path: Path, content: bytes) -> None:
    """Under its final name a file is complete: written beside it, then renamed."""
    part = path.with_name(f".{path.name}.part")
    part.write_bytes(content)
    part.replace(path)


class Recording:
    """One process's corner of OUT/parts, as a context manager; an event is one JSON line, written at once.

    A disk without room costs events, which are counted in the log, and never the process.
    """

    def __init__(self, run_dir: Path, process: str) -> None:
        self._parts = run_dir / "parts"
        (self._parts / "events").mkdir(parents=True, exist_ok=True)
        self._events = (self._parts / "events" / f"{process}.jsonl").open("ab", buffering=0)
        self._cut_short = False
        self.dropped = 0

    def note(self, stamp_ns: int, node_name: str, kind: str, fields: Mapping[str, Any]) -> None:
        """Write one event."""
        service, robot = split(node_name)
        line = {"stamp_ns": stamp_ns, "service": service, "robot": robot or None, "event": kind, **fields}
        self._write((json.dumps(line) + "\n").encode())

    def _write(self, line: bytes) -> None:
        whole = b"\n" + line if self._cut_short else line
        try:
            self._cut_short = self._events.write(whole) < len(whole)
        except OSError as error:
            if error.errno != errno.ENOSPC:
                raise
            self.dropped += 1
            log.warning("no room for events, %d dropped: %s", self.dropped, line.decode().strip())

    def save(self, node: Node) -> None:
        """Write a node's artifacts as parts/<service>[-robot].npz."""
        path = self._parts / f"{node.name.replace('/', '-')}.npz"
        part = path.with_name(f".{path.name}.part")
        with part.open("wb") as file:
            np.savez_compressed(file, **dict(node.artifacts()))  # type: ignore[arg-type]
        part.replace(path)

    def save_stages(self, node_name: str, stages: StageRecorder) -> None:
        """Write a node's stage durations as parts/stages-<service>[-robot].json."""
        self.save_json(f"stages-{node_name.replace('/', '-')}", dict(stages.durations_ns))

    def save_json(self, name: str, value: Any) -> None:
        """Write parts/<name>.json."""
        _write_whole(self._parts / f"{name}.json", json.dumps(value).encode())

    def __enter__(self) -> Recording:
        return self

    def __exit__(self, *_: object) -> None:
        os.fsync(self._events.fileno())
        self._events.close()
