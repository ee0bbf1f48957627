"""How a running cluster stands, for people: what the orchestrator has heard of everybody, and who holds what."""

from __future__ import annotations

from collections.abc import Mapping

from pydantic import BaseModel, ConfigDict

from orograph.messages import SECOND_NS, ManagerStatus, MappingStatus, RobotStatus
from orograph.mission.patrol import HEARD_NS

HEARD_S = HEARD_NS / SECOND_NS
"""A service is within radio if one of its last three statuses came."""


class _Plain(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid")


class MapStanding(_Plain):
    """One copy of the global map, the manager's own or a robot's, as its holder last reported it."""

    silent_s: float
    """Simulation time since that report [s]."""
    version: int
    hash: str
    """blake2b-128 in hexadecimal."""


class RobotStanding(_Plain):
    """One robot; what was never heard is None."""

    robot: str
    workers: dict[str, str]
    """Service -> instance that holds the robot; a service without a worker is not in it."""
    drive_silent_s: float | None = None
    """Simulation time since its navigator was heard over the radio [s]."""
    state: str = ""
    x_m: float = 0.0
    y_m: float = 0.0
    waypoints_left: int = 0
    backlog_cells: int | None = None
    """Cells that wait for the Map Manager's acknowledgement, as its robot-mapping last reported."""
    copy_held: MapStanding | None = None


class Standing(_Plain):
    """The whole cluster at one moment of simulation time."""

    run: str = ""
    scenario: str
    sim_time_s: float
    phase: str
    waypoints_left: int
    confident_cells: int
    cells: int
    manager: MapStanding | None
    robots: tuple[RobotStanding, ...]

    @property
    def coverage(self) -> float:
        """Share of the area's cells with confidence, 0..1."""
        return self.confident_cells / self.cells

    def of_run(self, run: str, workers: Mapping[str, Mapping[str, str]]) -> Standing:
        """With the run's name, and who holds each robot."""
        robots = tuple(r.model_copy(update={"workers": dict(workers.get(r.robot, {}))}) for r in self.robots)
        return self.model_copy(update={"run": run, "robots": robots})


class Ears:
    """The newest report of everybody, with the simulation time at which it came."""

    def __init__(self, robots: tuple[str, ...]) -> None:
        self._robots = robots
        self._drives: dict[str, tuple[int, RobotStatus]] = {}
        self._copies: dict[str, tuple[int, MappingStatus]] = {}
        self._manager: tuple[int, ManagerStatus] | None = None

    def hear(self, robot: str, message: object, now_ns: int) -> None:
        """Keep a status; everything else is left alone."""
        match message:
            case RobotStatus() if robot in self._robots:
                self._drives[robot] = now_ns, message
            case MappingStatus() if robot in self._robots:
                self._copies[robot] = now_ns, message
            case ManagerStatus():
                self._manager = now_ns, message

    @property
    def confident_cells(self) -> int:
        """As the manager last reported."""
        return self._manager[1].confident_cells if self._manager else 0

    def manager(self, now_ns: int) -> MapStanding | None:
        """The manager's own map."""
        if self._manager is None:
            return None
        heard_ns, status = self._manager
        return _map(now_ns - heard_ns, status.version, status.glrm_hash)

    def robot(self, robot: str, now_ns: int, waypoints_left: int) -> RobotStanding:
        """One robot without its workers, which are no matter of the radio."""
        known: dict[str, object] = {"robot": robot, "workers": {}, "waypoints_left": waypoints_left}
        if robot in self._drives:
            heard_ns, drive = self._drives[robot]
            known |= {"drive_silent_s": (now_ns - heard_ns) / SECOND_NS, "state": drive.state}
            known |= {"x_m": drive.x_m, "y_m": drive.y_m}
        if robot in self._copies:
            heard_ns, held = self._copies[robot]
            known["backlog_cells"] = held.waiting_cells
            known["copy_held"] = _map(now_ns - heard_ns, held.copy_version, held.copy_hash)
        return RobotStanding.model_validate(known)


def _map(silent_ns: int, version: int, digest: bytes) -> MapStanding:
    return MapStanding(silent_s=silent_ns / SECOND_NS, version=version, hash=digest.hex())


def link_up(silent_s: float | None) -> bool:
    """Whether a service last heard so long ago is within radio."""
    return silent_s is not None and silent_s < HEARD_S
