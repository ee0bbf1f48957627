"""A robot that should move and does not: noticing it, and the manoeuvre that gets it out."""

from __future__ import annotations

import math

from orograph.geometry import wrap_angle
from orograph.messages import SECOND_NS, Sensors
from orograph.navigation.follower import STOP, Command

STUCK_S = 3.0
"""Told to move for so long and in one place: the wheels push against something."""
STALLED_S = 8.0
"""In one place for so long with a goal ahead: what it waits for does not go away."""
MOVED_M, TURNED_RAD = 0.4, 0.3
"""Less than both of these is one place."""
DIFFERENTIAL = 2
SPUN_M, SPUN_MOVED_M = 2.0, 0.5
"""Wheels that have rolled so far, ahead less back, while the robot has not come so far, spin."""
ATTEMPTS_MAX = 3
ESCAPED_M = 6.0
"""This far from where it was stuck the robot has recovered."""
BACK_S, BACK_MPS = 2.0, -0.6
TURN_S, TURN_RADPS = 1.2, 1.0


class StuckWatch:
    """Tells when a robot has neither moved nor turned for a while."""

    def __init__(self, limit_s: float) -> None:
        self._limit_ns = round(limit_s * SECOND_NS)
        self._anchor: tuple[int, float, float, float] | None = None

    def reset(self) -> None:
        """Begin anew: the robot was told to stand, or something else has changed."""
        self._anchor = None

    def expired(self, now_ns: int, x_m: float, y_m: float, yaw_rad: float) -> bool:
        """Whether the robot has been in one place since `limit_s`."""
        if self._anchor is None or self._has_moved(x_m, y_m, yaw_rad):
            self._anchor = (now_ns, x_m, y_m, yaw_rad)
        return now_ns - self._anchor[0] > self._limit_ns

    def _has_moved(self, x_m: float, y_m: float, yaw_rad: float) -> bool:
        assert self._anchor is not None
        _, x, y, yaw = self._anchor
        return math.hypot(x - x_m, y - y_m) > MOVED_M or abs(wrap_angle(yaw_rad - yaw)) > TURNED_RAD


class WheelWatch:
    """Tells when wheels turn and the robot stays, on its belly or without grip; only differential GPS can say."""

    def __init__(self) -> None:
        self._turned_m, self._last_ns = 0.0, 0
        self._anchor: tuple[int, float, float] | None = None
        self.spinning = False

    def take(self, sensors: Sensors) -> None:
        """One frame's sensors; `spinning` holds until the robot has moved or its wheels have turned back."""
        if sensors.gps_quality < DIFFERENTIAL:
            self._anchor, self.spinning = None, False
            return
        stamp_ns, x_m, y_m = here = sensors.stamp_ns, sensors.gps_x_m, sensors.gps_y_m
        if self._anchor is None or math.dist(self._anchor[1:], (x_m, y_m)) > SPUN_MOVED_M:
            self._anchor, self._turned_m, self._last_ns = here, 0.0, stamp_ns
        self._turned_m += sensors.odometry_v_mps * (stamp_ns - self._last_ns) / SECOND_NS
        self._last_ns = stamp_ns
        self.spinning = abs(self._turned_m) > SPUN_M


class Recovery:
    """Backs up and turns, to alternate sides; counts attempts until the robot has come away from the place."""

    def __init__(self) -> None:
        self.attempts = 0
        self.total = 0
        self._begin_ns: int | None = None
        self._place = (0.0, 0.0)

    @property
    def active(self) -> bool:
        """A manoeuvre is under way."""
        return self._begin_ns is not None

    @property
    def exhausted(self) -> bool:
        """All attempts at this place have been made."""
        return self.attempts >= ATTEMPTS_MAX

    def begin(self, now_ns: int, x_m: float, y_m: float) -> None:
        """Start the next attempt."""
        if self.attempts == 0:
            self._place = (x_m, y_m)
        self.attempts += 1
        self.total += 1
        self._begin_ns = now_ns

    def command(self, now_ns: int, free_behind: bool) -> Command:
        """The manoeuvre's command now; `active` turns False when it is over."""
        assert self._begin_ns is not None
        elapsed_s = (now_ns - self._begin_ns) / SECOND_NS
        if elapsed_s < BACK_S:
            return Command(BACK_MPS, 0.0) if free_behind else STOP
        if elapsed_s < BACK_S + TURN_S:
            return Command(0.0, TURN_RADPS if self.attempts % 2 else -TURN_RADPS)
        self._begin_ns = None
        return STOP

    def escaped(self, x_m: float, y_m: float) -> bool:
        """True once, when the robot has come away from where it was stuck."""
        if self.attempts and math.dist(self._place, (x_m, y_m)) > ESCAPED_M:
            self.attempts = 0
            return True
        return False

    def forget(self) -> None:
        """Another goal: the count begins anew and a manoeuvre under way ends."""
        self.attempts, self._begin_ns = 0, None
