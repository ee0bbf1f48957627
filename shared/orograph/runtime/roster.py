"""Who takes part in a run: robots and the nodes that must be there before the first frame."""

from __future__ import annotations

from orograph import keys


class Roster:
    """Which robots are there: those of which every service takes part. A robot that came stays when a worker dies."""

    def __init__(self, robots: tuple[str, ...], start_with: int, joined: set[str]) -> None:
        """`joined` gets the robots that came, in place; the first frame waits for `start_with` of them."""
        self._robots, self._start_with, self._joined = robots, start_with, joined

    def __call__(self, nodes: set[str]) -> set[str]:
        """Take the nodes that take part now; returns those that the first frame still waits for."""
        needed = {robot: {keys.node(service, robot) for service in keys.ROBOT_SERVICES} for robot in self._robots}
        self._joined.update(robot for robot, its in needed.items() if its <= nodes)
        waited_for = {keys.MANAGER, keys.ORCHESTRATOR}
        if len(self._joined) < self._start_with:
            waited_for |= {name for its in needed.values() for name in its}
        return waited_for - nodes
