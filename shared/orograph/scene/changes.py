"""What stands when: the scenario's buildings and what its changes build, park and remove."""

from __future__ import annotations

import math

from orograph.scenario import Building, Change, Parked, Scenario


def solids(scenario: Scenario) -> dict[str, Building]:
    """Everything that ever stands on the ground, by its name in the scenario."""
    named = {f"buildings[{i}]": building for i, building in enumerate(scenario.buildings)}
    put = {f"changes[{i}]": _thing(change) for i, change in enumerate(scenario.changes)}
    return named | {name: thing for name, thing in put.items() if thing is not None}


def standing(scenario: Scenario, stamp_ns: int) -> list[str]:
    """Names of what stands at a time: what is left of the buildings, then what changes have put there."""
    now = {i: change for i, change in enumerate(scenario.changes) if change.holds(stamp_ns)}
    removed = {change.remove for change in now.values()}
    left = [f"buildings[{i}]" for i in range(len(scenario.buildings)) if i not in removed]
    return [*left, *(f"changes[{i}]" for i, change in now.items() if change.remove is None)]


def epoch(scenario: Scenario, stamp_ns: int) -> tuple[bool, ...]:
    """Which of the changes hold; at two stamps of one epoch the scene is the same."""
    return tuple(change.holds(stamp_ns) for change in scenario.changes)


def _thing(change: Change) -> Building | None:
    """What a change puts there; None where it removes something."""
    return change.build if change.park is None else _box(change.park)


def _box(parked: Parked) -> Building:
    length_m, width_m, height_m = parked.size_m
    c, s = math.cos(math.radians(parked.heading_deg)), math.sin(math.radians(parked.heading_deg))
    corners = [(a * length_m / 2, b * width_m / 2) for a, b in ((-1, -1), (1, -1), (1, 1), (-1, 1))]
    footprint = tuple((parked.x_m + c * x - s * y, parked.y_m + s * x + c * y) for x, y in corners)
    return Building(footprint=footprint, height_m=height_m)
