"""MUTANT: a robot that forgets its unsent cells when it hears the Map Manager again after a silence.

Only for the proof that the chaos checkers see; mounted into the container by an overlay, never in the product.
"""

from __future__ import annotations

import runpy

from orograph.messages import Packed
from orograph.protocol import robot
from orograph.protocol.outbox import Outbox


class ForgetfulOutbox(Outbox):
    """Takes what it has for sent when it is told to."""

    def forget(self) -> None:
        """Nothing is dirty any more."""
        self._acked[self._dirty] = self.own[self._dirty]
        self._dirty[:], self._in_flight[:], self._flights = False, False, []
        self._count()


class ForgetfulRobot(robot.RobotSync):
    """Clears its outbox on every reconnect, and tells its mapper that all was acknowledged."""

    _forgotten: Packed | None = None

    def _hear(self, now_ns: int) -> None:
        if self._heard_ns is not None and now_ns - self._heard_ns > robot.SILENCE_NS:
            assert isinstance(self._outbox, ForgetfulOutbox)
            self._forgotten = self._outbox.own[self._outbox._dirty].copy()
            self._outbox.forget()
        super()._hear(now_ns)

    def step(self, now_ns, inbox, send):  # type: ignore[no-untyped-def]
        """One step; what was forgotten counts as acknowledged."""
        self._forgotten = None
        result = super().step(now_ns, inbox, send)
        if self._forgotten is None:
            return result
        acknowledged = robot.np.concatenate([result.acknowledged, self._forgotten])
        return robot.SyncResult(acknowledged, result.adopted, result.first_life)


if __name__ == "__main__":
    robot.Outbox = ForgetfulOutbox  # type: ignore[misc]
    robot.RobotSync = ForgetfulRobot  # type: ignore[misc]
    runpy.run_module("services.robot_mapping", run_name="__main__")
