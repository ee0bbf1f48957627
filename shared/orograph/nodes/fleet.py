"""Who takes part in a run: robots and the nodes that must be there before the first frame."""

from __future__ import annotations

from orograph import keys
from orograph.scenario import Scenario


def robots_of(scenario: Scenario) -> tuple[str, ...]:
    """Ids of the run's robots, robot i from the i-th start."""
    return tuple(keys.robot_id(i + 1) for i in range(scenario.robots))


def required_nodes(robots: tuple[str, ...]) -> list[str]:
    """Every node but the world itself."""
    return [
        keys.MANAGER, keys.ORCHESTRATOR, *(keys.node(service, r) for service in keys.ROBOT_SERVICES for r in robots),
    ]  # fmt: skip
