"""Control messages: the world's clock, who holds which robot, what runs, and how things stand, for people.

Declared, checked and packed like the messages of nodes; each has a key of its own and travels whole.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import ClassVar, Final, Literal

from orograph import keys
from orograph.fields import Part, choice, flag, holds, integer, number, text
from orograph.keys import MANAGER, ORCHESTRATOR, RADIO, ROBOT_SERVICES, SIM, WORLD
from orograph.kinds import Each, Maybe, Number, Raw, Table, Text, Whole
from orograph.messages import CELLS_MAX, KINDS, PHASES, ROBOTS_MAX, STATES, U4, WAYPOINTS_MAX
from orograph.routes import ANYONE, PEOPLE, Route, Routed
from orograph.scenario import JSON_MAX_BYTES

STREAMS_MAX: Final = sum(
    ROBOTS_MAX if {route.sender, route.to} & set(ROBOT_SERVICES) else 1
    for route in {route for kind in KINDS.values() for route in kind.routes}
)
"""Streams of one frame in the largest run."""
CAPACITY_MAX: Final = 999
INSTANCES_MAX: Final = 1_000
"""Processes that take part at once."""
ZIPPED_MAX_BYTES: Final = JSON_MAX_BYTES + JSON_MAX_BYTES // 1000 + 64
"""What zlib makes of a scenario that it cannot make smaller."""

INSTANCE = Text(64, pattern="[A-Za-z0-9_-]+")
ROBOT = Text(9, pattern=keys.ROBOT_ID.pattern)
NODE = Text(32, pattern=f"[a-z-]+(/{keys.ROBOT_ID.pattern})?")
COUNTS = Table(Text(64, pattern=keys.STREAM), Whole(1, U4), STREAMS_MAX, "messages sent in a frame, by stream")
SIM_TIME_MAX_S = 1e6


class Control(Routed):
    """What keeps a run together; not for nodes."""

    key: ClassVar[str]
    """Key expression, `*` where a name stands."""
    manner: ClassVar[Literal["put", "query", "reply"]]

    def __init_subclass__(
        cls, *, routes: tuple[Route, ...], key: str, manner: Literal["put", "query", "reply"]
    ) -> None:
        super().__init_subclass__(routes=routes)
        cls.key, cls.manner = key, manner


@dataclass(frozen=True)
class Tick(Control, routes=(Route(SIM, WORLD, ANYONE),), key=keys.TICK, manner="put"):
    """A frame begins: step with what was sent in the frame before, then answer."""

    frame: int = integer(0, U4)
    lockstep: bool = flag("True: step only when all that was counted for you is here, and answer at once")
    end: bool = flag("True: the run is over, this is no frame")
    counted: dict[str, int] = holds(COUNTS)
    down: tuple[str, ...] = holds(Each(ROBOT, ROBOTS_MAX, "robots that had no radio in the frame before"))
    roster: tuple[str, ...] = holds(Each(INSTANCE, INSTANCES_MAX, "instances that are awaited; others join first"))


@dataclass(frozen=True)
class Answer(Control, routes=(Route(SIM, ANYONE, WORLD),), key=f"{keys.DONE}/*", manner="put"):
    """A participant has stepped; of frame -1 it only wishes to join. Repeated until the next tick."""

    instance: str = holds(INSTANCE)
    nodes: tuple[str, ...] = holds(Each(NODE, 3 * ROBOTS_MAX, "nodes of this process"))
    frame: int = integer(-1, U4)
    sent: dict[str, int] = holds(COUNTS)
    lost: int = integer(0, U4, "counted messages that never came, since the last answer")


@dataclass(frozen=True)
class Claim(Control, routes=tuple(Route(SIM, s, ORCHESTRATOR) for s in ROBOT_SERVICES), key=keys.CLAIM, manner="query"):
    """A process asks for robots; asked again, it gets the same."""

    service: str = choice(ROBOT_SERVICES)
    instance: str = holds(INSTANCE)
    capacity: int = integer(1, CAPACITY_MAX, "how many robots it can hold")
    wanted: tuple[str, ...] = holds(Each(ROBOT, ROBOTS_MAX, "empty: whichever are free"))


@dataclass(frozen=True)
class Grant(Control, routes=tuple(Route(SIM, ORCHESTRATOR, s) for s in ROBOT_SERVICES), key=keys.CLAIM, manner="reply"):
    """The robots given, which a liveliness token must show within 5 s; or none, and why."""

    robots: tuple[str, ...] = holds(Each(ROBOT, ROBOTS_MAX))
    reason: str = text(4_000, "why there are none: wait as a spare, and ask again")


@dataclass(frozen=True)
class Release(
    Control, routes=tuple(Route(SIM, ORCHESTRATOR, s) for s in ROBOT_SERVICES), key=f"{keys.RELEASE}/*", manner="put"
):
    """Give your robots back and claim anew: another robot needs you more."""


@dataclass(frozen=True)
class CurrentRun(
    Control, routes=(Route(SIM, ORCHESTRATOR, ANYONE), Route(SIM, WORLD, ANYONE)), key=keys.BRIEFING, manner="reply"
):
    """What runs; the query for it carries nothing."""

    run: str = text(255, "name of the run's folder")
    scenario: bytes = holds(Raw(0, ZIPPED_MAX_BYTES, "zlib over the resolved scenario's JSON"))


@dataclass(frozen=True)
class Figures(Control, routes=(Route(SIM, ANYONE, PEOPLE),), key=f"{keys.TELEMETRY}/*/*", manner="put"):
    """A node's figures, twice a second; never read by a node."""

    figures: dict[str, float] = holds(Table(Text(64, pattern="[a-z][a-z0-9_]*"), Number(-1e18, 1e18), 1_000))


@dataclass(frozen=True)
class HeldMap:
    """One copy of the global map, the manager's own or a robot's, as its holder last reported it."""

    silent_s: float = number(0, SIM_TIME_MAX_S, "simulation time since that report")
    version: int = integer(0, U4)
    hash: str = text(32, "blake2b-128 in hexadecimal")


@dataclass(frozen=True)
class RobotState:
    """One robot; what was never heard is None."""

    robot: str = holds(ROBOT)
    workers: dict[str, str] = holds(Table(Text(16), INSTANCE, len(ROBOT_SERVICES), "service -> who holds the robot"))
    drive_silent_s: float | None = holds(Maybe(Number(0, SIM_TIME_MAX_S), "since its navigator was heard"))
    state: str = choice(("", *STATES))
    x_m: float = number(-1e6, 1e6)
    y_m: float = number(-1e6, 1e6)
    waypoints_left: int = integer(0, WAYPOINTS_MAX)
    revoked: bool = flag("nothing of it is in the map, nothing is taken from it, and nobody is given it")
    backlog_cells: int | None = holds(Maybe(Whole(0, CELLS_MAX), "cells that wait for their acknowledgement"))
    copy_held: HeldMap | None = holds(Maybe(Part(HeldMap)))


@dataclass(frozen=True)
class ClusterStatus(Control, routes=(Route(RADIO, ORCHESTRATOR, PEOPLE),), key=keys.STATUS, manner="reply"):
    """The whole cluster at one moment of simulation time; the query for it carries nothing."""

    run: str = text(255, "name of the run's folder")
    scenario: str = text(64)
    sim_time_s: float = number(0, SIM_TIME_MAX_S)
    phase: str = choice(("starting", *PHASES))
    waypoints_left: int = integer(0, WAYPOINTS_MAX)
    confident_cells: int = integer(0, CELLS_MAX)
    cells: int = integer(1, CELLS_MAX)
    manager: HeldMap | None = holds(Maybe(Part(HeldMap)))
    robots: tuple[RobotState, ...] = holds(Each(Part(RobotState), ROBOTS_MAX))

    @property
    def coverage(self) -> float:
        """Share of the area's cells with confidence, 0..1."""
        return self.confident_cells / self.cells

    def of_run(self, run: str, workers: Mapping[str, Mapping[str, str]]) -> ClusterStatus:
        """With the run's name, and who holds each robot."""
        robots = tuple(replace(r, workers=dict(workers.get(r.robot, {}))) for r in self.robots)
        return replace(self, run=run, robots=robots)


@dataclass(frozen=True)
class Revoke(Control, routes=(Route(RADIO, PEOPLE, MANAGER),), key=keys.REVOKE, manner="query"):
    """A person wants a robot out of the map for good; asked again until the answer names it."""

    robot: str = holds(ROBOT)


@dataclass(frozen=True)
class Revoked(Control, routes=(Route(RADIO, MANAGER, PEOPLE),), key=keys.REVOKE, manner="reply"):
    """Whose revocation would survive kill -9."""

    robots: tuple[str, ...] = holds(Each(ROBOT, ROBOTS_MAX))
    reason: str = text(400, "why the robot that was asked for can never be one of them")


CONTROLS: Final[dict[str, type[Control]]] = {kind.__name__: kind for kind in Control.__subclasses__()}
