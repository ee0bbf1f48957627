"""How much a robot and the Map Manager say at once (protocol.md, "Bounds")."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Limits:
    """The defaults fill the messages' bounds; smaller ones make a small map's answers come in many parts."""

    batch_cells: int = 256
    """Records in a batch."""
    largest_change_share: int = 64
    """Of a batch's cells, so many go to the largest changes once the backlog is longer than a batch."""
    batches_in_flight: int = 4
    """Of one robot: sent, neither acknowledged nor given up."""
    messages_per_step: int = 16
    """From one robot; more are counted and dropped, so that a flood costs nobody else."""
    part_cells: int = 1024
    """In one part of a beat, a repair or a welcome."""
    answers_per_step: int = 32
    """Parts of welcomes and repairs in one step, over all robots in turn."""
    parts_per_robot: int = 4
    """Of those, in one robot's turn."""


LIMITS = Limits()
