"""Tiles of 20 x 20 cells and the hashes by which two holders of a map compare it (protocol.md, "Down")."""

from __future__ import annotations

import hashlib
from typing import Any

import numpy as np
import numpy.typing as npt

from orograph.arrays import I64, U1
from orograph.layers import BASIC_LAYERS, MAPPED, MAPPED_LAYERS
from orograph.messages import TILE_CELLS, Packed

HASH_BYTES = 16


def map_hash(cells: Packed) -> bytes:
    """blake2b-128 over the canonical little-endian arrays of the mapped layers, in their order.

    Where nothing is known of what stands, in no cell, its layers are left out: a map of one surface.
    """
    digest = hashlib.blake2b(digest_size=HASH_BYTES)
    stands = any(cells[kind.name].any() for kind in MAPPED if not kind.basic and kind.blank == 0)
    for name in MAPPED_LAYERS if stands else BASIC_LAYERS:
        digest.update(np.ascontiguousarray(cells[name]).tobytes())
    return digest.digest()


class Tiles:
    """How a map of shape (rows, cols) is cut: numbers run along columns first; tiles at the far edges are smaller."""

    def __init__(self, shape: tuple[int, int]) -> None:
        rows, cols = shape
        self._across = -(-cols // TILE_CELLS)
        self.count = -(-rows // TILE_CELLS) * self._across
        row, col = np.divmod(np.arange(rows * cols), cols)
        self._tile_of: I64 = (row // TILE_CELLS) * self._across + col // TILE_CELLS
        by_tile = np.argsort(self._tile_of, kind="stable")
        self._cells = np.split(by_tile, np.cumsum(np.bincount(self._tile_of, minlength=self.count))[:-1])

    def of(self, cells: npt.NDArray[Any]) -> I64:
        """Numbers of the tiles in which these cells (n,) lie, ascending, each once."""
        return np.unique(self._tile_of[cells.astype(np.int64)])

    def cells(self, tile: int) -> I64:
        """The cells of one tile, ascending."""
        return self._cells[tile]


class TileHashes:
    """Hashes (tiles, 16) u1 of a map that somebody else changes and tells of; only touched tiles are hashed again."""

    def __init__(self, tiles: Tiles, cells: Packed) -> None:
        self._tiles, self._map = tiles, cells
        self._hashes = np.zeros((tiles.count, HASH_BYTES), np.uint8)
        self._stale = np.ones(tiles.count, np.bool_)

    def touch(self, cells: npt.NDArray[Any]) -> None:
        """These cells may have changed."""
        self._stale[self._tiles.of(cells)] = True

    def current(self) -> U1:
        """Hashes of the map as it is now; do not write to it."""
        for tile in np.flatnonzero(self._stale):
            digest = map_hash(self._map[self._tiles.cells(int(tile))])
            self._hashes[tile] = np.frombuffer(digest, np.uint8)
        self._stale[:] = False
        return self._hashes
