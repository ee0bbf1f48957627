"""MUTANT: a robot that forgets its unsent cells when it hears the Map Manager again after a silence.

Only for the proof that the chaos checkers see; mounted into the container by an overlay, never in the product.
"""

from __future__ import annotations

import runpy

from orograph.protocol import robot
from orograph.protocol.outbox import Outbox


class ForgetfulOutbox(Outbox):
    """Takes what it has for sent when it is told to."""

    def forget(self) -> None:
        """Nothing is dirty any more."""
        self._clear(robot.np.flatnonzero(self._dirty), 0)
        self._in_flight[:], self._flights = False, []


class ForgetfulRobot(robot.RobotSync):
    """Clears its outbox on every reconnect: what was forgotten counts as acknowledged."""

    def _hear(self, now_ns: int) -> None:
        if self._heard_ns is not None and now_ns - self._heard_ns > robot.SILENCE_NS:
            assert isinstance(self._outbox, ForgetfulOutbox)
            self._outbox.forget()
        super()._hear(now_ns)


if __name__ == "__main__":
    robot.Outbox = ForgetfulOutbox  # type: ignore[misc]
    robot.RobotSync = ForgetfulRobot  # type: ignore[misc]
    runpy.run_module("services.robot_mapping", run_name="__main__")
