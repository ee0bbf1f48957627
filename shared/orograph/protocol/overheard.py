"""The global map as one knows it who only listens to what the Map Manager tells the robots."""

from __future__ import annotations

from numpy.lib.recfunctions import require_fields

from orograph.messages import CELL, Delta, Packed


class OverheardMap:
    """`cells` (n,) CELL begin as the prior; a cell is overwritten by a newer version of itself only.

    A manager that began anew counts its versions anew, and the newest life of it is believed: a robot would ask it
    first (copy.py), a listener asks nobody.
    """

    def __init__(self, prior: Packed) -> None:
        self.cells: Packed = require_fields(prior, CELL)
        self._manager_epoch = 0

    def catch_up(self, glrm: Packed, manager_epoch: int) -> None:
        """Begin with the map of a life of the manager, as that had committed it."""
        self.cells[:], self._manager_epoch = glrm, manager_epoch

    def take(self, delta: Delta) -> Packed:
        """The cells (m,) that a delta changed."""
        if delta.manager_epoch < self._manager_epoch:
            return delta.cells[:0]
        if delta.manager_epoch > self._manager_epoch:
            self._manager_epoch, self.cells["version"] = delta.manager_epoch, 0
        told: Packed = delta.cells[delta.cells["cell"] < len(self.cells)]
        newer: Packed = told[told["version"] > self.cells["version"][told["cell"]]]
        self.cells[newer["cell"]] = newer
        return newer
