"""From maps and a goal to a path: the global route, the local path along it, and what blocks it now."""

from __future__ import annotations

import math

import numpy as np

from orograph.arrays import F64, U1
from orograph.layers import UNKNOWN_OCCUPATION
from orograph.messages import SECOND_NS, OccupancyGrid
from orograph.navigation.follower import braking_distance_m
from orograph.navigation.movers import Movers
from orograph.navigation.planner import (
    BLOCKED,
    LocalPath,
    PointXY,
    global_route,
    local_path,
    local_target,
    local_window,
    planning_grid,
)
from orograph.navigation.planner_kernels import first_blocked, obstacle_near_m

BODY_M = 0.7
"""An obstacle's cell centre nearer than this to the path blocks it."""
LEAVING_M = 1.2
BETWEEN_M = 0.25
"""Half of what lies between two path points: there the obstacle may begin already."""
SLOWLY_M = 1.0
"""So much free way lets the robot drive at about 1 m/s: then it stops within half a metre."""
OFF_ROUTE_M = 15.0
BLIND_S = 1.5
SHUT_S = 90.0
"""For so long the global route avoids a place where the robot has failed."""


class Guide:
    """Holds the newest maps, the route to the goal, and the places that are shut for a while."""

    def __init__(self) -> None:
        self._local: OccupancyGrid | None = None
        self._recent: list[OccupancyGrid] = []
        """The newest three local maps: what is blocked only since the first of them moves."""
        self._movers = Movers()
        self._global: OccupancyGrid | None = None
        self._goals: tuple[PointXY, ...] = ()
        self._routes: list[F64] = []
        """To the goal, and from there to the one after it."""
        self._shut: dict[tuple[int, int], int] = {}
        self.global_replans = 0
        self.local_replans = 0
        self.goal_index: int | None = None
        """Where the newest path reaches the goal, None if it ends before."""

    def take(self, planning_map: OccupancyGrid) -> None:
        """Keep a newer map; a new GLRM that blocks the present route makes it be planned anew."""
        if not planning_map.is_global:
            self._local = planning_map
            self._recent = [*self._recent[-2:], planning_map]
            self._movers.take(planning_map, self._recent[0])
            return
        self._global = planning_map
        if any(self._blocked_by(planning_map, route) for route in self._routes):
            self._routes = []

    @staticmethod
    def _blocked_by(planning_map: OccupancyGrid, route: F64) -> bool:
        rows, cols = planning_grid(planning_map).rows_cols(route[1:-1])
        values = planning_map.occupation[rows, cols]
        return bool(np.any((values >= BLOCKED) & (values != UNKNOWN_OCCUPATION)))

    def sees(self, now_ns: int) -> bool:
        """Whether there is a GLRM and a local map that is not too old to drive by."""
        fresh = self._local is not None and now_ns - self._local.stamp_ns <= BLIND_S * SECOND_NS
        return fresh and self._global is not None

    def aim(self, goals: tuple[PointXY, ...]) -> tuple[bool, bool]:
        """Set the goal and the one after it, if any: (the goal is another one, the present path leads there)."""
        changed = goals[:1] != self._goals[:1]
        continued = changed and goals[:1] == self._goals[1:2]
        if continued:
            self._routes = self._routes[1:]
        elif changed:
            self._routes = []
        if goals[1:] != self._goals[1:]:
            self._routes = self._routes[:1]
        self._goals = goals
        return changed, continued

    def shut_ahead(self, now_ns: int, x_m: float, y_m: float) -> None:
        """Avoid the part of the route 4 to 14 m ahead for a while: the robot has failed there."""
        if not self._routes or self._global is None:
            return
        route = self._routes[0]
        away = np.hypot(route[:, 0] - x_m, route[:, 1] - y_m)
        ahead = np.arange(len(away)) >= int(np.argmin(away))
        grid = planning_grid(self._global)
        for x, y in route[ahead & (away > 4.0) & (away < 14.0)]:
            cell = grid.row_col(x, y)
            if cell is not None:
                self._shut[cell] = now_ns
        self._routes = []

    def plan(self, now_ns: int, x_m: float, y_m: float) -> LocalPath | None:
        """A fresh local path towards the goal, and on from there if it is near; None if there is no way."""
        if not self._goals or self._global is None or self._local is None:
            return None
        window = local_window(self._local, (x_m, y_m))
        if window is None or not self._plan_routes(now_ns, self._global, x_m, y_m):
            return None
        self.local_replans += 1
        grid = planning_grid(window)
        target, is_goal = local_target(self._routes[0], (x_m, y_m), grid)
        targets = [target]
        if is_goal and len(self._routes) > 1:
            targets.append(local_target(self._routes[1], self._goals[0], grid)[0])
        path = local_path(window, (x_m, y_m), targets, self._global)
        self.goal_index = path.legs[0] if path is not None and is_goal else None
        return path

    def _plan_routes(self, now_ns: int, global_map: OccupancyGrid, x_m: float, y_m: float) -> bool:
        """Complete the routes to the goals; False if there is none to the first."""
        if self._routes and np.min(np.hypot(*(self._routes[0] - (x_m, y_m)).T)) > OFF_ROUTE_M:
            self._routes = []
        if not self._routes:
            self._shut = {cell: t for cell, t in self._shut.items() if now_ns - t < SHUT_S * SECOND_NS}
        while len(self._routes) < len(self._goals):
            start = self._goals[len(self._routes) - 1] if self._routes else (x_m, y_m)
            route = global_route(global_map, start, self._goals[len(self._routes)], self._shut)
            self.global_replans += 1
            if route is None:
                break
            self._routes.append(route)
        return bool(self._routes)

    def free_ahead_m(
        self, path: LocalPath, arc_m: F64, along_m: float, at: PointXY, horizon_m: float, now_ns: int, v_mps: float
    ) -> float:
        """Metres of path ahead, up to the horizon, without an obstacle on the newest local map.

        A robot that stands too near to something may leave: at first the path must only not lead nearer to it.
        Before something that moves towards the path it stops if it still can; else it had better pass.
        """
        ends = np.searchsorted(arc_m, along_m + np.array([0.0, LEAVING_M, horizon_m]), side="right")
        begin, leaving, end = (int(i) for i in ends)
        here_m = self._obstacle_m(*at)
        hit = self._first_blocked(path.xy_m, begin, leaving, min(BODY_M, here_m - 0.05))
        if hit < 0:
            hit = self._first_blocked(path.xy_m, leaving, end, BODY_M)
        free_m = horizon_m if hit < 0 else float(arc_m[hit] - along_m) - BETWEEN_M
        return min(free_m, self._yield_m(path.xy_m[begin:end], arc_m[begin:end] - along_m, now_ns, v_mps))

    def _yield_m(self, path_m: F64, arc_m: F64, now_ns: int, v_mps: float) -> float:
        """How far the robot may go before something that moves has crossed its way; infinite if nothing does.

        Where something only might come its way it goes on slowly. What stands in a mover's way gets out of it if
        it can in time, but never towards a mover.
        """
        foretold = self._movers.meetings(now_ns, path_m, arc_m, v_mps, careful=False)
        if any(m.head_on and m.met_m < math.inf for m in foretold):
            return max(0.0, min(m.wait_m for m in foretold if m.head_on))
        if self._movers.escapes(now_ns, path_m, arc_m, v_mps):
            return math.inf
        stops_m = [m.wait_m for m in foretold if m.met_m < math.inf]
        swept_m = min((m.swept_m for m in foretold), default=math.inf)
        if stops_m or swept_m < BETWEEN_M:
            return min(stops_m, default=math.inf)
        might = self._movers.meetings(now_ns, path_m, arc_m, v_mps, careful=True)
        return min([
            self._movers.appeared_m(path_m, arc_m, braking_distance_m(v_mps)) - BETWEEN_M,
            *(max(m.wait_m, min(SLOWLY_M, swept_m - BETWEEN_M)) for m in might if m.met_m < math.inf),
        ])  # fmt: skip

    def free_behind(self, x_m: float, y_m: float, yaw_rad: float) -> bool:
        """Whether the robot can back up a little."""
        c, s = math.cos(yaw_rad), math.sin(yaw_rad)
        behind = np.array([(x_m - d * c, y_m - d * s) for d in (0.9, 1.2)])
        return self._first_blocked(behind, 0, 2, 0.5) < 0

    def _obstacle_m(self, x_m: float, y_m: float) -> float:
        assert self._local is not None
        return float(obstacle_near_m(x_m, y_m, *self._seen(self._local), BODY_M))

    def _first_blocked(self, xy_m: F64, begin: int, end: int, radius_m: float) -> int:
        assert self._local is not None
        return int(first_blocked(xy_m, begin, end, *self._seen(self._local), radius_m))

    @staticmethod
    def _seen(local: OccupancyGrid) -> tuple[U1, tuple[float, float, float], int, int]:
        """What the kernels need of a map."""
        return local.occupation, (local.x0_m, local.y0_m, local.cell_m), BLOCKED, UNKNOWN_OCCUPATION
