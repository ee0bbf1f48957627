"""What the orchestrator has heard of everybody, and how the cluster stands by it."""

from __future__ import annotations

from orograph.control import ClusterStatus, HeldMap, RobotState
from orograph.keys import robot_number
from orograph.messages import SECOND_NS, ManagerStatus, MappingStatus, RobotStatus
from orograph.mission.patrol import HEARD_NS, Patrol

HEARD_S = HEARD_NS / SECOND_NS
"""A service is within radio if one of its last three statuses came."""


class StatusBoard:
    """The newest report of everybody, with the simulation time at which it came."""

    def __init__(self, robots: tuple[str, ...], scenario: str, cells: int) -> None:
        """`cells` are those of the global map."""
        self._robots, self._scenario, self._cells = robots, scenario, cells
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

    def status(self, now_ns: int, phase: str, patrol: Patrol | None) -> ClusterStatus:
        """How everybody stands, without the run's name and who holds the robots, which are no matter of the radio."""
        manager = self._manager
        return ClusterStatus(
            run="", scenario=self._scenario, sim_time_s=now_ns / SECOND_NS, phase=phase,
            waypoints_left=len(patrol.open()) if patrol else 0,
            confident_cells=manager[1].confident_cells if manager else 0, cells=self._cells,
            manager=_held(now_ns - manager[0], manager[1].version, manager[1].glrm_hash) if manager else None,
            robots=tuple(self._robot(r, now_ns, patrol) for r in self._robots),
        )  # fmt: skip

    def _robot(self, robot: str, now_ns: int, patrol: Patrol | None) -> RobotState:
        revoked = self._manager is not None and robot_number(robot) in self._manager[1].revoked
        heard_ns, drive = self._drives.get(robot, (0, None))
        told_ns, copy = self._copies.get(robot, (0, None))
        return RobotState(
            robot=robot, workers={}, waypoints_left=len(patrol.left(robot)) if patrol else 0, revoked=revoked,
            drive_silent_s=(now_ns - heard_ns) / SECOND_NS if drive else None, state=drive.state if drive else "",
            x_m=drive.x_m if drive else 0.0, y_m=drive.y_m if drive else 0.0,
            backlog_cells=copy.waiting_cells if copy else None,
            copy_held=_held(now_ns - told_ns, copy.copy_version, copy.copy_hash) if copy else None,
        )  # fmt: skip


def _held(silent_ns: int, version: int, digest: bytes) -> HeldMap:
    return HeldMap(silent_ns / SECOND_NS, version, digest.hex())


def link_up(silent_s: float | None) -> bool:
    """Whether a service last heard so long ago is within radio."""
    return silent_s is not None and silent_s < HEARD_S
