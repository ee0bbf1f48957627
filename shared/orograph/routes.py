"""Who may send what to whom: routes are data of every message, and all else about addressing follows from them.

Receivers refuse what came on no route of its kind; the reference of messages, the README's picture, observers and
access rules are made from the same table.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass
from typing import ClassVar

from orograph import keys
from orograph.kinds import Rejected

ANYONE, PEOPLE = "anyone", "people"
"""In routes of control messages: every service that takes part, and those who look on."""


@dataclass(frozen=True)
class Route:
    """From a service to a service, or to a group (`robot-mapping/*`): that service of every robot at once.

    A robot's services speak to the same robot's services only, and to those that are no robot's.
    """

    plane: str
    sender: str
    to: str

    def carries(self, plane: str, sender: str, to: str) -> bool:
        """Whether a message from this node to this address goes along here."""
        from_service, from_robot = keys.split(sender)
        to_service, to_robot = keys.split(to)
        return (
            (plane, from_service) == (self.plane, self.sender)
            and self.to == (to if to_robot == keys.EVERY else to_service)
            and all(bool(robot) == (service in keys.ROBOT_SERVICES) for service, robot in
                    ((from_service, from_robot), (to_service, to_robot)))
            and (not from_robot or to_robot in ("", from_robot))
        )  # fmt: skip


class Routed:
    """What travels between nodes; a class says along which routes, and what a newer one of its kind replaces."""

    routes: ClassVar[tuple[Route, ...]]
    newest_by: ClassVar[tuple[str, ...] | None]
    """Fields that tell streams apart of which a late receiver wants the newest alone; None: it wants every one."""

    def __init_subclass__(cls, *, routes: tuple[Route, ...] = (), newest_by: tuple[str, ...] | None = None) -> None:
        cls.routes, cls.newest_by = routes, newest_by


def check_route(kind: type[Routed], plane: str, sender: str, to: str, robots: Collection[str]) -> None:
    """Raise Rejected for a message that came along no route of its kind, or from a robot that is not in this run."""
    if not any(route.carries(plane, sender, to) for route in kind.routes):
        raise Rejected("route", f"{kind.__name__} from {sender} to {to} on {plane}")
    if (robot := keys.split(sender)[1]) and robot not in robots:
        raise Rejected("robot", robot)
