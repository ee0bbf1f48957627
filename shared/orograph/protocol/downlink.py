"""What the Map Manager tells the robots: beats, digests, and answers cut into parts (protocol.md, "Down")."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator

import numpy as np

from orograph.arrays import I64
from orograph.messages import CellsRequest, Delta, Digest, Message, Packed, Welcome
from orograph.protocol.limits import Limits
from orograph.protocol.tiles import TileHashes, Tiles

BEAT_NS = 500_000_000
DIGEST_NS = 2_000_000_000

SendTo = Callable[[str | None, Message], None]
"""send(robot, message); None is every robot."""


class Downlink:
    """Publishes `cells` (CELL, committed values only, owned by the manager) of one manager epoch."""

    def __init__(self, manager_epoch: int, version: int, tiles: Tiles, cells: Packed, limits: Limits) -> None:
        self._epoch, self._tiles, self._cells, self._limits = manager_epoch, tiles, cells, limits
        self._hashes = TileHashes(tiles, cells)
        self._published = self.version = version
        self._beat_due_ns = self._digest_due_ns = 0
        self._answers: dict[tuple[str, str], Iterator[Message]] = {}
        self.counts: Counter[str] = Counter()

    def changed(self, cells: I64, version: int) -> None:
        """A commit made this version and changed these cells."""
        self.version = version
        if len(cells):
            self._hashes.touch(cells)

    def welcome(self, robot: str, nonce: bytes, epoch: int, row: Packed) -> None:
        """Answer a hello; an answer already on its way goes on unless it is for another nonce or epoch."""
        self._begin((robot, f"welcome {nonce.hex()} {epoch}"), self._welcome_parts(nonce, epoch, row))

    def repair(self, robot: str, request: CellsRequest) -> None:
        """Answer a request for cells; while one answer is on its way a second request waits to be made again."""
        self._begin((robot, "repair"), self._repair_parts(request))

    def _begin(self, key: tuple[str, str], parts: Iterator[Message]) -> None:
        if key in self._answers:
            return
        kind = key[1].split()[0]
        for robot, what in list(self._answers):
            if robot == key[0] and what.split()[0] == kind:
                del self._answers[robot, what]
        self._answers[key] = parts

    def _cut(self, items: I64 | Packed) -> list[I64]:
        return np.split(items, range(self._limits.part_cells, len(items), self._limits.part_cells))

    def _welcome_parts(self, nonce: bytes, epoch: int, row: Packed) -> Iterator[Message]:
        parts = self._cut(row)
        for number, part in enumerate(parts):
            yield Welcome(nonce, epoch, self._epoch, number, len(parts), part)

    def _repair_parts(self, request: CellsRequest) -> Iterator[Message]:
        version = self.version
        if len(request.tiles):
            cells = np.sort(np.concatenate([self._tiles.cells(int(tile)) for tile in np.unique(request.tiles)]))
            return self._delta_parts(version, version, cells, repair=True)
        cells = np.flatnonzero(self._cells["version"] > request.since_version)
        return self._delta_parts(request.since_version, version, cells, repair=True)

    def _delta_parts(self, first: int, last: int, cells: I64, repair: bool) -> Iterator[Delta]:
        """Parts are read when they are sent: a value newer than `last` does no harm, an older one cannot be.

        Whole tiles (`first` = `last`) are marked as of now, so that they replace whatever the copy holds.
        """
        parts = self._cut(cells)
        for number, part in enumerate(parts):
            values = self._cells[part]
            if first == last:
                values["version"] = self.version
            yield Delta(self._epoch, first, last, number, len(parts), repair, values)

    def step(self, now_ns: int, send: SendTo) -> None:
        """Send what is due: answers, a beat with what changed since the last, a digest straight after a beat."""
        self._send_answers(send)
        digest_due = now_ns >= self._digest_due_ns
        if self.version > self._published and (digest_due or now_ns >= self._beat_due_ns):
            self._send_beat(send)
            self._beat_due_ns = now_ns + BEAT_NS
        if digest_due:
            send(None, Digest(self._epoch, self.version, self._hashes.current().copy()))
            self._digest_due_ns = now_ns + DIGEST_NS
            self.counts["digests"] += 1

    def _send_beat(self, send: SendTo) -> None:
        cells = np.flatnonzero(self._cells["version"] > self._published)
        for part in self._delta_parts(self._published, self.version, cells, repair=False):
            send(None, part)
        self._published = self.version
        self.counts["beats"] += 1

    def _send_answers(self, send: SendTo) -> None:
        """Every robot in turn, one part at a time, until the step's allowance is spent."""
        most = self._limits.answers_per_step
        for key in list(self._answers)[:most]:
            answer = self._answers.pop(key)
            for _ in range(min(self._limits.parts_per_robot, max(1, most // (len(self._answers) + 1)))):
                part = next(answer, None)
                if part is None:
                    break
                send(key[0], part)
                self.counts["answers"] += 1
            else:
                self._answers[key] = answer
