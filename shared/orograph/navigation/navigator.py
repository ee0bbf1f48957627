"""The navigator of one robot: pose from its sensors, the way to its next waypoint, and a drive command each frame."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

from orograph.fields import saturated
from orograph.keys import robot_number
from orograph.messages import SECOND_NS, Mission, OccupancyGrid, Pose, RobotStatus, Sensors
from orograph.navigation.ekf import PoseFilter
from orograph.navigation.follower import STOP, Command, Follower
from orograph.navigation.guide import Guide
from orograph.navigation.recovery import STALLED_S, STUCK_S, Recovery, StuckWatch, WheelWatch
from orograph.navigation.return_path import ReturnPath
from orograph.navigation.tour import Tour
from orograph.node import Note
from orograph.scenario import PointM
from orograph.scene.site import Site

START_SIGMA_M, START_YAW_SIGMA_RAD = 0.3, math.radians(5.0)
DRIVE_SIGMA_M = 3.0
"""The robot stands while its position is less certain than this."""
REPLAN_S, REPLAN_BLOCKED_S = 2.0, 0.8
LEFT_M, OFF_PATH_M = 12.0, 2.0
"""A local path is planned anew when less than this is left of it, or the robot is this far beside it."""
HORIZON_M, NEAR_M = 12.0, 6.0
"""The path is watched this far ahead; for an obstacle nearer than NEAR_M the robot waits before it goes round."""
WAIT_S, WAIT_STEP_S = 1.0, 0.4
"""How long it waits for a moving obstacle; longer by robot number, so that two robots do not dodge alike for ever."""
ARRIVED_M = 0.8
LEG_S, LEG_MPS = 60.0, 0.5
"""A leg may take LEG_S and its straight length at LEG_MPS, whatever happens; then it is given up."""


class Navigator:
    """Sans-I/O: sensors, maps and missions in; pose, command and status out. Time is the caller's."""

    def __init__(self, site: Site, robot: str) -> None:
        self._scenario = scenario = site.scenario
        self._prior = site.prior_map
        self._ground = self._prior.height, self._prior.gradient_x, self._prior.gradient_y
        self._start = scenario.starts[robot_number(robot) - 1]
        self._wait_ns = round((WAIT_S + WAIT_STEP_S * (robot_number(robot) % 4)) * SECOND_NS)
        self.pose = PoseFilter(scenario.navigation_sensors)
        self.tour = Tour(scenario.patrol)
        self.guide = Guide()
        self.recovery = Recovery()
        self.state = "idle"
        self._return = ReturnPath(scenario.base_station_m)
        self._follower = Follower(scenario.robot)
        self._pushing, self._stalled = StuckWatch(STUCK_S), StuckWatch(STALLED_S)
        self._wheels, self._spun = WheelWatch(), False
        self._planned_ns = self._blocked_ns = self._leg_end_ns = -1
        self._finished_mission = 0

    def take_sensors(self, sensors: Sensors) -> Pose:
        """Update the pose; at the very start of a run the scenario's start is known, after a restart only GPS is."""
        if not self.pose.started and sensors.stamp_ns < SECOND_NS:
            x, y = self._start.x_m, self._start.y_m
            ground_m, heading = self.ground_m(x, y), math.radians(self._start.heading_deg)
            z = sensors.gps_z_m if ground_m is None else ground_m
            self.pose.start(x, y, z, heading, START_SIGMA_M, START_YAW_SIGMA_RAD)
        ground_m = self.ground_m(self.pose.x_m, self.pose.y_m) if self.pose.started else None
        self.pose.update(sensors, ground_m)
        self._wheels.take(sensors)
        return self.pose.pose(sensors.stamp_ns)

    def ground_m(self, x_m: float, y_m: float) -> float | None:
        """Height of the ground by the prior map's plane there; None where it knows none, as under a roof."""
        cell = self._prior.grid.row_col(x_m, y_m)
        if cell is None:
            return None
        x, y = self._prior.grid.centre_m(*cell)
        height_m, slope_x, slope_y = (float(layer[cell]) for layer in self._ground)
        ground_m = height_m + slope_x * (x_m - x) + slope_y * (y_m - y)
        return None if math.isnan(ground_m) else ground_m

    def take_map(self, planning_map: OccupancyGrid) -> None:
        """Keep a newer planning map."""
        self.guide.take(planning_map)

    def hear(self, mission: Mission, now_ns: int) -> None:
        """A mission arrived, new or repeated: the radio is up here."""
        self.tour.take(mission)
        if self.pose.started:
            self._return.heard(now_ns, self.pose.x_m, self.pose.y_m)

    def status(self, stamp_ns: int) -> RobotStatus:
        """What the orchestrator is told."""
        visited, given_up = self.tour.status_arrays()
        return saturated(
            RobotStatus, stamp_ns=stamp_ns, mission=self.tour.number, visited=visited, given_up=given_up,
            state=self.state, x_m=self.pose.x_m, y_m=self.pose.y_m,
        )  # fmt: skip

    def step(self, now_ns: int, note: Note) -> Command:
        """The command for this frame."""
        if self._wheels.spinning and not self._spun:
            note("wheels-spin", {"x_m": round(self.pose.x_m, 1), "y_m": round(self.pose.y_m, 1)})
        self._spun = self._wheels.spinning
        if now_ns >= self._scenario.duration_max_s * SECOND_NS:
            self.tour.flush = True
        if self.pose.position_sigma_m > DRIVE_SIGMA_M or not self.guide.sees(now_ns):
            return self._stand()
        for index in self.tour.visit(self.pose.x_m, self.pose.y_m):
            note("waypoint", {"index": index})
        goals = self._goals(now_ns, note)
        if not goals:
            return self._stand()
        changed, on_the_way = self.guide.aim(goals)
        if changed:
            self._begin_leg(now_ns, goals[0], on_the_way)
        return self._drive(now_ns, note)

    def _stand(self) -> Command:
        self._pushing.reset()
        self._stalled.reset()
        self._follower.take(None)
        return STOP

    def _goals(self, now_ns: int, note: Note) -> tuple[PointM, ...]:
        """The next waypoints, or the way back to the radio once nothing is left; sets the state."""
        goals = self.tour.goals()
        if goals:
            self.state = "recovering" if self.recovery.active else "driving"
            return goals
        at = (self.pose.x_m, self.pose.y_m)
        back = self._return.goal(now_ns, at)
        rest = "idle" if self.tour.number == 0 else ("blocked" if self.tour.unreached else "done")
        if self._finished_mission < self.tour.number:
            self._finished_mission = self.tour.number
            if not self.tour.flush:
                note("done", {"mission": self.tour.number, "given_up": len(self.tour.given_up)})
        if back is not None and self.state != "returning":
            note("returning", {"x_m": round(back[0], 1), "y_m": round(back[1], 1)})
        self.state = rest if back is None else "returning"
        return (back,) if back is not None else ()

    def _begin_leg(self, now_ns: int, goal: PointM, on_the_way: bool) -> None:
        away_m = math.dist(goal, (self.pose.x_m, self.pose.y_m))
        self._leg_end_ns = now_ns + round((LEG_S + away_m / LEG_MPS) * SECOND_NS)
        self.recovery.forget()
        self.guide.goal_index = None
        if not on_the_way:
            self._planned_ns = self._blocked_ns = -1

    def _drive(self, now_ns: int, note: Note) -> Command:
        x, y, yaw = self.pose.x_m, self.pose.y_m, self.pose.yaw_rad
        if self.recovery.active:
            return self._recover(now_ns)
        if self.recovery.escaped(x, y):
            note("recovered", {"x_m": round(x, 1), "y_m": round(y, 1)})
        free_m = self._look_ahead(now_ns)
        if self._plan_due(now_ns, free_m):
            self._follower.take(self.guide.plan(now_ns, x, y))
            self._planned_ns = now_ns
            free_m = self._look_ahead(now_ns)
        command = STOP
        if self._follower.path is not None:
            command = self._follower.command(x, y, yaw, self.pose.v_mps, free_m)
        if self._arrived():
            self._abandon(now_ns, note, "cannot come nearer")
        elif self._no_progress(now_ns, command):
            self._escape(now_ns, note)
        return command

    def _look_ahead(self, now_ns: int) -> float:
        """Free metres of the path ahead; remembers since when an obstacle is near."""
        path = self._follower.path
        if path is None:
            return 0.0
        at = (self.pose.x_m, self.pose.y_m)
        along_m = self._follower.advance(*at)
        v_mps = self.pose.v_mps
        free_m = self.guide.free_ahead_m(path, self._follower.arc_m, along_m, at, HORIZON_M, now_ns, v_mps)
        if free_m >= NEAR_M:
            self._blocked_ns = -1
        elif self._blocked_ns < 0:
            self._blocked_ns = now_ns
        return free_m

    def _plan_due(self, now_ns: int, free_m: float) -> bool:
        if self._planned_ns < 0:
            return True
        age_s = (now_ns - self._planned_ns) / SECOND_NS
        path = self._follower.path
        if path is None or free_m < HORIZON_M:
            waited = self._blocked_ns < 0 or now_ns - self._blocked_ns >= self._wait_ns
            return age_s >= REPLAN_BLOCKED_S and waited
        beside = self._follower.off_path_m(self.pose.x_m, self.pose.y_m) > OFF_PATH_M
        short = self._follower.remaining_m < LEFT_M and self.guide.goal_index != len(path.xy_m) - 1
        return age_s >= (REPLAN_BLOCKED_S if beside or short else REPLAN_S)

    def _arrived(self) -> bool:
        """Where the path comes nearest to the goal, and yet the waypoint does not count as visited."""
        path, index = self._follower.path, self.guide.goal_index
        if path is None or index is None or self.state != "driving":
            return False
        return math.dist(path.xy_m[index], (self.pose.x_m, self.pose.y_m)) < ARRIVED_M

    def _no_progress(self, now_ns: int, command: Command) -> bool:
        place = (self.pose.x_m, self.pose.y_m, self.pose.yaw_rad)
        if abs(command.v_mps) < 0.1 and abs(command.yaw_rate_radps) < 0.2:
            self._pushing.reset()
        stuck = self._pushing.expired(now_ns, *place)
        stuck |= self._wheels.spinning
        return self._stalled.expired(now_ns, *place) or stuck or now_ns > self._leg_end_ns

    def _escape(self, now_ns: int, note: Note) -> None:
        """Begin a recovery, or give the goal up when they have not helped."""
        if self.recovery.exhausted or now_ns > self._leg_end_ns:
            self._abandon(now_ns, note, "stuck")
            return
        x, y = self.pose.x_m, self.pose.y_m
        note("stuck", {"x_m": round(x, 1), "y_m": round(y, 1), "attempt": self.recovery.attempts + 1})
        self.recovery.begin(now_ns, x, y)
        if self.recovery.attempts > 1:
            self.guide.shut_ahead(now_ns, x, y)

    def _abandon(self, now_ns: int, note: Note, why: str) -> None:
        if not self.tour.left:
            self._return.abandon()
        else:
            note("gave-up", {"index": self.tour.give_up(), "why": why})
        self.recovery.forget()
        self._planned_ns = -1
        self._pushing.reset()
        self._stalled.reset()

    def _recover(self, now_ns: int) -> Command:
        behind = self.guide.free_behind(self.pose.x_m, self.pose.y_m, self.pose.yaw_rad)
        command = self.recovery.command(now_ns, behind)
        if not self.recovery.active:
            self._wheels = WheelWatch()
            self._planned_ns = self._blocked_ns = -1
            self._pushing.reset()
            self._stalled.reset()
        return command

    def telemetry(self) -> Mapping[str, Any]:
        """Figures for people."""
        return {
            "position_sigma_m": min(self.pose.position_sigma_m, 1e6),
            "driven_m": self.pose.moved_m,
            "global_replans": float(self.guide.global_replans),
            "local_replans": float(self.guide.local_replans),
            "recoveries": float(self.recovery.total),
            "waypoints_left": float(len(self.tour.left)),
        }
