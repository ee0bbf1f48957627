"""Collisions: what pushes a robot along the ground (`contact_kernels`), and how pushes of frames become one contact."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace

import numpy as np

from orograph.arrays import F64

APART_NS = 1_000_000_000
"""Pushes of one body with less than this between them are one contact."""
TOUCH_M = 0.4
"""A body this near to a robot's outline has touched it: within a frame they may have parted."""
OUTLINE = np.array([(x, y) for x in np.linspace(-0.5, 0.5, 7) for y in np.linspace(-0.5, 0.5, 7)
                    if max(abs(x), abs(y)) == 0.5])  # fmt: skip
"""Places on a body's outline, in shares of its length and width."""
STATIC = "building"


@dataclass(frozen=True, eq=False)
class Outline:
    """Where a body stands: x, y, yaw, length and width in metres and radians."""

    x_m: float
    y_m: float
    yaw_rad: float
    length_m: float
    width_m: float

    def places_m(self) -> F64:
        """Places (n, 2) on the outline in the map frame."""
        ahead, left = OUTLINE[:, 0] * self.length_m, OUTLINE[:, 1] * self.width_m
        c, s = np.cos(self.yaw_rad), np.sin(self.yaw_rad)
        return np.column_stack([self.x_m + c * ahead - s * left, self.y_m + s * ahead + c * left])

    def nearness_m(self, places_m: F64) -> float:
        """How far the nearest of places (n, 2) lies outside, negative inside (a square's distance)."""
        x, y = places_m[:, 0] - self.x_m, places_m[:, 1] - self.y_m
        c, s = np.cos(self.yaw_rad), np.sin(self.yaw_rad)
        beyond = np.abs(c * x + s * y) - self.length_m / 2, np.abs(c * y - s * x) - self.width_m / 2
        return float(np.maximum(*beyond).min())


def touched(robot: Outline, others: Mapping[str, Outline]) -> str:
    """Name of the body that touches a robot; `building` where none of them does."""
    gaps = {
        name: min(other.nearness_m(robot.places_m()), robot.nearness_m(other.places_m()))
        for name, other in others.items()
    }
    nearest = min(gaps, key=lambda name: gaps[name], default=STATIC)
    return nearest if gaps.get(nearest, np.inf) < TOUCH_M else STATIC


@dataclass(frozen=True)
class Contact:
    """One collision of a robot: with what, where and since when; the greatest force, and how long it was pushed."""

    robot: str
    body: str
    x_m: float
    y_m: float
    since_ns: int
    last_ns: int
    newtons: float
    seconds: float


class ContactBook:
    """Joins the pushes of single frames to contacts."""

    def __init__(self) -> None:
        self._open: dict[tuple[str, str], Contact] = {}

    def push(self, push: Contact) -> bool:
        """Take one frame's push; True if a new contact begins with it."""
        before = self._open.get((push.robot, push.body))
        whole = push if before is None else replace(
            before, last_ns=push.last_ns, newtons=max(before.newtons, push.newtons),
            seconds=before.seconds + push.seconds,
        )  # fmt: skip
        self._open[push.robot, push.body] = whole
        return before is None

    def over(self, now_ns: int) -> Iterator[Contact]:
        """Contacts whose body has not pushed for a while, each told once."""
        done = [key for key, contact in self._open.items() if now_ns - contact.last_ns >= APART_NS]
        return iter([self._open.pop(key) for key in done])

    def rest(self) -> Iterator[Contact]:
        """All that are still open, at the end of a run."""
        ending, self._open = list(self._open.values()), {}
        return iter(ending)
