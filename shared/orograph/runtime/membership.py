"""Who holds which robot: claims and leases (architecture.md, "Identity")."""

from __future__ import annotations

from collections.abc import Collection, Iterable

from orograph import keys
from orograph.control import Grant


class Membership:
    """The table of (service, robot) -> instance; at most one live instance holds each pair."""

    def __init__(self, robots: tuple[str, ...]) -> None:
        self._robots = robots
        self._holder: dict[tuple[str, str], str] = {}
        self._former: dict[tuple[str, str], str] = {}

    def claim(
        self, service: str, instance: str, capacity: int, wanted: tuple[str, ...] = (), revoked: Collection[str] = (),
    ) -> Grant:  # fmt: skip
        """Up to `capacity` free robots, of those `wanted` if any are named; asked again, one instance gets the same.

        Nobody is given those that are `revoked`.
        """
        if strangers := [r for r in wanted if r not in self._robots]:
            return Grant((), f"{', '.join(strangers)}: not in this run of {len(self._robots)} robots")
        if held := self.held(service, instance):
            return Grant(held, "")
        open_to_all = [r for r in self._robots if r in (wanted or self._robots) and r not in revoked]
        free = [r for r in open_to_all if (service, r) not in self._holder]
        free.sort(key=lambda r: (self._former.get((service, r)) != instance, -self._need(r)))
        given = tuple(sorted(free[:capacity]))
        if not given:
            named = ", ".join(wanted) or f"all {len(self._robots)} robots"
            why = f"{service} is held by others" if open_to_all else "revoked"
            return Grant((), f"{named}: {why}; wait as a spare")
        self._hold(service, instance, given)
        return Grant(given, "")

    def _need(self, robot: str) -> int:
        """What a robot already has makes it the next to be filled, its mapping (which holds evidence) above all."""
        return sum(4 if s == keys.MAPPING else 1 for s in keys.ROBOT_SERVICES if (s, robot) in self._holder)

    def strays(self) -> tuple[tuple[str, str], ...]:
        """(service, instance) of workers that would do more for another robot, as after a fleet has shrunk.

        Such a worker holds only robots without mapping, while a robot with mapping lacks its service. Mapping itself
        never moves: it holds evidence that may not be acknowledged yet.
        """
        mapped = {r for r in self._robots if (keys.MAPPING, r) in self._holder}
        out: list[tuple[str, str]] = []
        for service in keys.ROBOT_SERVICES:
            gaps = [r for r in sorted(mapped) if (service, r) not in self._holder]
            instances = sorted({i for (s, _), i in self._holder.items() if s == service})
            idle = [i for i in instances if not mapped & set(self.held(service, i))]
            out += [(service, instance) for instance in idle[: len(gaps)]]
        return tuple(out)

    def held(self, service: str, instance: str) -> tuple[str, ...]:
        """Robots that this instance holds, in order."""
        return tuple(r for r in self._robots if self._holder.get((service, r)) == instance)

    def lost(self, service: str, instance: str) -> None:
        """The instance's liveliness token is gone: its robots are free, and its again if it is the next to ask."""
        for robot in self.held(service, instance):
            del self._holder[(service, robot)]

    def restore(self, tokens: Iterable[tuple[str, str, tuple[str, ...]]]) -> None:
        """Enter live tokens (service, instance, robots), as after a restart; who is in the table already stays."""
        for service, instance, robots in tokens:
            if service in keys.ROBOT_SERVICES:
                self._hold(service, instance, tuple(r for r in robots if r in self._robots))

    def holders(self) -> dict[str, dict[str, str]]:
        """Robot -> service -> instance, of all that is held."""
        held: dict[str, dict[str, str]] = {robot: {} for robot in self._robots}
        for (service, robot), instance in self._holder.items():
            held[robot][service] = instance
        return held

    def complete(self) -> tuple[str, ...]:
        """Robots of which every service is held."""
        return tuple(r for r in self._robots if all((s, r) in self._holder for s in keys.ROBOT_SERVICES))

    def _hold(self, service: str, instance: str, robots: tuple[str, ...]) -> None:
        for robot in robots:
            if self._holder.setdefault((service, robot), instance) == instance:
                self._former[(service, robot)] = instance
