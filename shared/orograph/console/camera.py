"""Where browsers look from: each its own camera; saved views, flights, and one that follows a robot."""

from __future__ import annotations

import numpy as np
import viser

from orograph.arrays import F64
from orograph.console.film import YAW, Film

BEHIND_M, ABOVE_M = 36.0, 55.0
VIEWS = ("whole", "from above")


class Cameras:
    """`follow` moves those that follow a robot."""

    def __init__(self, server: viser.ViserServer, film: Film) -> None:
        x0, y0, x1, y1 = film.site.scenario.grid.grid.extent_m
        self._server, self._size_m = server, max(x1 - x0, y1 - y0)
        ground_m = float(film.site.scene().height_m((x0 + x1) / 2, (y0 + y1) / 2))
        self._centre_m = np.array([(x0 + x1) / 2, (y0 + y1) / 2, ground_m])
        self._following: dict[int, str] = {}
        server.scene.set_up_direction("+z")
        server.initial_camera.position = tuple(self._eye("whole"))
        server.initial_camera.look_at = tuple(self._centre_m)
        server.on_client_disconnect(self._forget)

    def _eye(self, view: str) -> F64:
        away = (0.1, -0.66, 0.5) if view == "whole" else (0.0, -0.001, 1.15)
        return np.asarray(self._centre_m + self._size_m * np.array(away))

    def _forget(self, client: viser.ClientHandle) -> None:
        self._following.pop(client.client_id, None)

    def view(self, client: viser.ClientHandle, view: str) -> None:
        """Look from one of VIEWS."""
        self._forget(client)
        client.camera.position, client.camera.look_at = self._eye(view), self._centre_m

    def fly(self, client: viser.ClientHandle, to_m: F64) -> None:
        """Look at a place from near by, from the south."""
        self._forget(client)
        client.camera.position, client.camera.look_at = to_m + np.array([0.0, -2.0 * BEHIND_M, 1.2 * ABOVE_M]), to_m

    def begin_to_follow(self, client: viser.ClientHandle, robot: str) -> None:
        """From the next picture on, until another view is asked for; a robot that is none ends it."""
        self._following[client.client_id] = robot

    def follow(self, film: Film, stamp_ns: int) -> None:
        """Move the cameras that follow."""
        clients = self._server.get_clients()
        for client_id, robot in list(self._following.items()):
            pose = film.pose(robot, stamp_ns) if robot in film.robots else None
            if client_id in clients and pose is not None:
                ahead = np.array([np.cos(pose[YAW]), np.sin(pose[YAW]), 0.0])
                camera = clients[client_id].camera
                with clients[client_id].atomic():
                    camera.position = pose[1:4] - BEHIND_M * ahead + np.array([0.0, 0.0, ABOVE_M])
                    camera.look_at = pose[1:4] + 0.4 * BEHIND_M * ahead
