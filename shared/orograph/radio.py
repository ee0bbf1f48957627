"""The scenario's radio: which messages of the radio plane are lost, as a function of (seed, sender, number) alone."""

from __future__ import annotations

from collections.abc import Mapping

from orograph.keys import split
from orograph.randomness import stream


def delivers(
    seed: int, loss: float, radio_up: Mapping[str, bool], sender: str, receiver: str, frame: int, index: int
) -> bool:
    """Whether one radio message reaches one receiver.

    A robot that stood in a radio shadow when the message was sent neither sends nor receives; the base station's
    services are always in reach. Modelled loss is drawn per receiver.
    """
    for node in (sender, receiver):
        robot = split(node)[1]
        if robot and not radio_up.get(robot, True):
            return False
    return loss <= 0.0 or bool(stream(seed, "radio", sender, receiver, str(index), frame=frame).random() >= loss)
