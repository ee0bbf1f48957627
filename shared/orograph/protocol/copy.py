"""A robot's copy of the GLRM: versioned deltas, gaps, tile digests, repairs (protocol.md, "Down")."""

from __future__ import annotations

from collections import Counter

import numpy as np

from orograph.arrays import I64
from orograph.grid import Grid
from orograph.layers import MAPPED_LAYERS, CellMap, Layer
from orograph.messages import CELL, U4, CellsRequest, Delta, Digest, Packed
from orograph.protocol.tiles import TileHashes, Tiles, map_hash
from orograph.registers import unpack

NO_TILES = np.zeros(0, "<u2")
PAST_DIGESTS_MAX = 8
"""So many in a row, 16 s of them, and the versions here are taken for a lie; late ones come a few at a time."""
PARTS_KEPT = 8
"""Deltas of which some parts have come: the oldest is forgotten when there are more."""


class GlrmCopy:
    """The GLRM as of `version` of `manager_epoch`, or newer in single cells; begins as the prior.

    A cell is overwritten by the same or a newer version of itself only, so doubled, late and reordered messages do
    no harm, and what comes over a gap is taken cell by cell. The version rises only when nothing up to it is missing:
    by a beat or a complete answer that begins where the copy stands, by a digest that agrees in all tiles, or when
    every cell of the tiles in which it did not agree has been repaired.

    Words of another life of the manager change nothing until that life has answered a question of this copy; then a
    digest of it must tell what of the copy still holds. So a manager that lost its store is followed as one that
    restarted, and no single message, forged or late, makes the copy leave the life that it follows.
    """

    def __init__(self, shape: tuple[int, int], prior: Packed) -> None:
        self.cells = np.zeros(len(prior), CELL)
        self.cells["cell"] = prior["cell"]
        for name in MAPPED_LAYERS:
            self.cells[name] = prior[name]
        self._tiles = Tiles(shape)
        self._hashes = TileHashes(self._tiles, self.cells)
        self.manager_epoch = self.version = 0
        self.wanted: CellsRequest | None = None
        """What this copy lacks and should ask for."""
        self._asked = False
        self._stranger = 0
        """Another life of the manager than the one followed, which has been heard since the latter."""
        self._unsure = False
        """The manager began a new life: a digest must tell what of this copy still holds."""
        self._lacking = np.zeros(len(prior), np.bool_)
        self._lacking_since = 0
        """Version of the digest that found these cells' tiles to differ."""
        self._past_digests = 0
        self._parts: dict[tuple[int, int, int, bool], set[int]] = {}
        self.repairs = 0
        """Parts of repairs that came: they change cells without raising the version."""
        self.counts: Counter[str] = Counter()

    def hash(self) -> bytes:
        """blake2b-128 of the whole copy."""
        return map_hash(self.cells)

    def cell_map(self, grid: Grid, gps_quality: Layer | None = None, communications: Layer | None = None) -> CellMap:
        """The copy as a map over `grid`, given layers as passed."""
        return unpack(self.cells, grid, gps_quality, communications)

    def asked(self) -> None:
        """The wanted request went out."""
        self._asked = True
        self.counts["requests"] += 1

    def take_delta(self, delta: Delta) -> None:
        """Apply a part of a beat or of a repair, and raise the version when it is complete."""
        if self._answers(delta):
            self._follow(delta.manager_epoch)
        if not self._followed(delta.manager_epoch):
            return
        outside = len(delta.cells) and int(delta.cells["cell"].max()) >= len(self.cells)
        if outside or delta.part >= delta.parts:
            self.counts["rejected"] += 1
        elif delta.repair:
            self.repairs += 1
            self._apply(delta)
            self._repaired(delta)
        elif delta.last_version > self.version:
            self._take_beat(delta)

    def _take_beat(self, beat: Delta) -> None:
        gap = beat.first_version > self.version
        self._apply(beat)
        self.counts["gaps"] += gap
        if gap and not self._unsure:
            self._want_since()

    def _answers(self, delta: Delta) -> bool:
        """Whether another life of the manager answers what this copy asked it, so that it is the one that lives."""
        wanted = self.wanted if delta.repair and self._asked else None
        asked = (wanted.manager_epoch, wanted.since_version) if wanted else None
        return asked == (delta.manager_epoch, delta.first_version) and delta.manager_epoch == self._stranger

    def _followed(self, manager_epoch: int) -> bool:
        """Whether a message is of the life that this copy follows; the first that is heard, until another answers."""
        if self.manager_epoch == 0:
            self.manager_epoch = manager_epoch
        if manager_epoch == self.manager_epoch:
            if self._stranger:
                self._stranger, self.wanted = 0, None
            return True
        self.counts["strangers"] += 1
        if manager_epoch != self._stranger:
            self._stranger, self._asked = manager_epoch, False
            question = U4 - self.counts["strangers"]  # a version that is none: the answer names it and holds no cells
            self.wanted = CellsRequest(manager_epoch, question, NO_TILES)
        return False

    def _follow(self, manager_epoch: int) -> None:
        """Begin to follow a life of the manager: all versions here are uncertain."""
        self.manager_epoch, self.version, self._unsure = manager_epoch, 0, True
        self.cells["version"] = 0
        self._stranger = self._past_digests = 0
        self._parts.clear()
        self.wanted = None
        self._lacking[:] = False

    def _apply(self, delta: Delta) -> None:
        cells = delta.cells["cell"].astype(np.int64)
        newer = delta.cells["version"] >= self.cells["version"][cells]
        self.cells[cells[newer]] = delta.cells[newer]
        if newer.any():
            self._hashes.touch(cells[newer])
        if self._complete(delta):
            self._reach(delta)

    def _complete(self, delta: Delta) -> bool:
        key = (delta.first_version, delta.last_version, delta.parts, delta.repair)
        parts = self._parts.setdefault(key, set())
        parts.add(delta.part)
        if len(parts) < delta.parts:
            while len(self._parts) > PARTS_KEPT:
                del self._parts[next(iter(self._parts))]
            return False
        del self._parts[key]
        return True

    def _reach(self, delta: Delta) -> None:
        if delta.first_version <= self.version < delta.last_version and not self._unsure:
            self._rise(delta.last_version)

    def _rise(self, version: int) -> None:
        self.version, self._unsure, self.wanted = version, False, None
        self._lacking[:] = False

    def _repaired(self, repair: Delta) -> None:
        """Tick off cells of the tiles that differed; all of them done, the copy is at the digest's version."""
        if not self._lacking.any() or repair.last_version < self._lacking_since:
            return
        self._lacking[repair.cells["cell"]] = False
        if self._lacking.any():
            self._want_tiles(self._tiles.of(np.flatnonzero(self._lacking)))
        else:
            self._confirm(max(self.version, self._lacking_since))

    def take_digest(self, digest: Digest) -> None:
        """Compare with the manager's tiles: equal, then this copy is at that version; else want what differs."""
        if digest.tiles.shape != (self._tiles.count, 16):
            self.counts["rejected"] += 1
        elif self._followed(digest.manager_epoch) and not self._is_past(digest.version):
            self._compare(digest)

    def _is_past(self, version: int) -> bool:
        """Whether the copy is ahead of a digest: it is late, or the copy was misled, which many in a row prove."""
        ahead = version < max(self.version, int(self.cells["version"].max()))
        self._past_digests = self._past_digests + 1 if ahead else 0
        if self._past_digests >= PAST_DIGESTS_MAX:
            self.counts["misled"] += 1
            self._follow(self.manager_epoch)
        return version < self.version

    def _compare(self, digest: Digest) -> None:
        differing = np.flatnonzero((self._hashes.current() != digest.tiles).any(axis=1))
        if not len(differing):
            self.counts["matches"] += 1
            self._confirm(digest.version)
        elif digest.version > self.version and not self._unsure and not (self.wanted and self._asked):
            self._want_since()
        else:
            self.counts["mismatches"] += 1
            self._lacking_since = digest.version
            self._lacking[:] = False
            for tile in differing:
                self._lacking[self._tiles.cells(int(tile))] = True
            self._want_tiles(differing)

    def _confirm(self, version: int) -> None:
        """Every cell is as of that version or newer, so nothing older may overwrite it any more."""
        self._rise(version)
        self.cells["version"] = np.maximum(self.cells["version"], version)

    def _want_since(self) -> None:
        if self.wanted is None:
            self.wanted, self._asked = CellsRequest(self.manager_epoch, self.version, NO_TILES), False

    def _want_tiles(self, tiles: I64) -> None:
        self.wanted = CellsRequest(self.manager_epoch, self.version, tiles.astype("<u2"))
