"""What a process leaves in the run folder: its events while it runs, its nodes' arrays and stage times at the end."""

from __future__ import annotations

import errno
import json
import logging
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from orograph.keys import split
from orograph.node import Node
from orograph.stages import StageRecorder
from orograph.storage import run_folder
from orograph.storage.results import WorldResult

log = logging.getLogger("orograph.recording")


class Recording:
    """One process's corner of OUT/parts, as a context manager; an event is one JSON line, written at once.

    A disk without room costs events, which are counted in the log, and never the process.
    """

    def __init__(self, run_dir: Path, process: str) -> None:
        self._out, self._process = run_dir, process
        events = run_dir / run_folder.events_file(process)
        events.parent.mkdir(parents=True, exist_ok=True)
        self._events = events.open("ab", buffering=0)
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
        """Write a node's artifacts."""
        run_folder.write_arrays(self._out / run_folder.node_file(node.name), node.artifacts())

    def save_stages(self, node_name: str, stages: StageRecorder) -> None:
        """Write a node's stage durations."""
        self._save_json(run_folder.stages_file(node_name), stages.durations_ns)

    def save_bytes(self, up: Mapping[str, int], down: Mapping[str, int]) -> None:
        """Write what this process counted on the radio plane, robot -> bytes it sent and received."""
        self._save_json(run_folder.bytes_file(self._process), {"up": dict(up), "down": dict(down)})

    def save_figures(self, figures: Mapping[str, Any]) -> None:
        """Write this process's own figures."""
        self._save_json(run_folder.process_file(self._process), figures)

    def save_result(self, result: WorldResult) -> None:
        """Write how the run ended: the world's last word."""
        result.write(self._out)

    def _save_json(self, file: str, value: Mapping[str, Any]) -> None:
        run_folder.write_whole(self._out / file, json.dumps(dict(value)))

    def __enter__(self) -> Recording:
        return self

    def __exit__(self, *_: object) -> None:
        os.fsync(self._events.fileno())
        self._events.close()
