"""What moves over the map, and what is drawn on it: robots, trails, links, vehicles, scans, legs, radio shadows."""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np
import viser

from orograph.arrays import F64
from orograph.console.colours import linear_bytes, robot_rgb
from orograph.console.film import RADIO, YAW, Film, row_at
from orograph.grid import Grid
from orograph.scene.bodies import vehicle_box

TRAIL_POINTS = 300
SILENT_RGB = (150, 60, 60)
LINK_RGB = (70, 160, 220)
SHADOW_RGB = (95, 30, 110)
PICKED_RGB = (255, 60, 160)
FRAME = ((-1, -1), (1, -1), (1, 1), (-1, 1), (-1, -1))
VEHICLE_RGB = (240, 180, 40)
NO_SEGMENTS: F64 = np.zeros((0, 2, 3))


class Actors:
    """Nodes by name under one scene; each is made once and moved. `size_m` is that of the map's longer side."""

    def __init__(self, scene: viser.SceneApi, film: Film, size_m: float) -> None:
        self._scene, self._site = scene, film.site
        self._ground = film.site.scene()
        self._big_m = max(2.0, size_m / 70)
        """Robots are drawn larger than they are, or nobody would find them in a square kilometre."""
        self._robots = {robot: self._marker(robot, i) for i, robot in enumerate(film.robots)}
        self._labels = {robot: scene.add_label(f"/robots/{robot}/name", robot, position=(0, 0, 2.4 * self._big_m),
                                               font_screen_scale=0.9, anchor="bottom-center")
                        for robot in film.robots}  # fmt: skip
        self._rgb = {robot: robot_rgb(i) for i, robot in enumerate(film.robots)}
        self._lines: dict[str, viser.LineSegmentsHandle] = {}
        self._vehicles = [self._vehicle(i) for i in range(len(film.vehicles))]
        self._scans = {robot: scene.add_point_cloud(f"/scans/{robot}", np.zeros((0, 3), np.float32), self._rgb[robot],
                                                    point_size=size_m / 1500, point_shape="circle")
                       for robot in film.robots}  # fmt: skip
        self._drawn_scans: dict[str, F64] = {}
        self._base_m = self._on_ground(*film.site.scenario.base_station_m, 2.5 * self._big_m)
        self._base()
        self._shadows = self._radio_shadows()

    def _on_ground(self, x_m: float, y_m: float, above_m: float = 0.0) -> F64:
        return np.array([x_m, y_m, float(self._ground.height_m(x_m, y_m)) + above_m])

    def _marker(self, robot: str, index: int) -> viser.MeshHandle:
        """An arrowhead that points where the robot drives."""
        outline = np.array([(1.0, 0.0), (-0.8, 0.75), (-0.4, 0.0), (-0.8, -0.75)]) * self._big_m
        low, high = 0.25 * self._big_m, 0.75 * self._big_m
        vertices = np.vstack([np.c_[outline, np.full(4, z)] for z in (low, high)]).astype(np.float32)
        caps = [(0, 2, 1), (0, 3, 2), (4, 5, 6), (4, 6, 7)]
        walls = [f for a, b in pairwise((0, 1, 2, 3, 0)) for f in ((a, b, b + 4), (a, b + 4, a + 4))]
        return self._scene.add_mesh_simple(
            f"/robots/{robot}", vertices, np.array([*caps, *walls], np.uint32), color=robot_rgb(index),
            flat_shading=True, side="double", cast_shadow=False, visible=False,
        )  # fmt: skip

    def _vehicle(self, index: int) -> viser.BoxHandle:
        box = vehicle_box(self._site.scenario.vehicles[index])
        size_m = max(1.0, self._big_m / 4)
        return self._scene.add_box(
            f"/vehicles/{index}", color=VEHICLE_RGB, dimensions=(box.length_m * size_m, box.width_m * size_m,
                                                                 box.height_m * size_m), cast_shadow=False,
        )  # fmt: skip

    def _base(self) -> None:
        x, y, top = self._base_m
        foot = top - 2.5 * self._big_m
        self._scene.add_line_segments("/base/mast", np.array([[(x, y, foot), (x, y, top)]]), LINK_RGB,
                                      thickness=3, thickness_units="screen")  # fmt: skip
        self._scene.add_icosphere("/base/top", 0.35 * self._big_m, LINK_RGB, position=(x, y, top), cast_shadow=False)
        self._scene.add_label("/base/name", "base", position=(x, y, top + 0.5 * self._big_m), font_screen_scale=0.8,
                              anchor="bottom-center")  # fmt: skip

    def _radio_shadows(self) -> viser.SceneNodeHandle:
        """Boxes of dusk where no radio reaches."""
        node = self._scene.add_frame("/shadows", show_axes=False)
        for i, area in enumerate(self._site.scenario.communications.areas):
            x0, y0, x1, y1 = area.rectangle_m
            x, y, z = self._on_ground((x0 + x1) / 2, (y0 + y1) / 2, 8.0)
            if area.value == 0:
                self._scene.add_box(f"/shadows/{i}", SHADOW_RGB, (x1 - x0, y1 - y0, 24.0), opacity=0.22,
                                    position=(x, y, z), cast_shadow=False, receive_shadow=False)  # fmt: skip
        return node

    def mark(self, grid: Grid, cell: tuple[int, int] | None, height_m: float) -> None:
        """Draw a frame round a cell at its height, or none."""
        corners = NO_SEGMENTS
        if cell is not None and math.isfinite(height_m):
            (x, y), half = grid.centre_m(*cell), grid.cell_m / 2
            ring = [(x + dx * half, y + dy * half, height_m + 0.3) for dx, dy in FRAME]
            corners = np.array(list(pairwise(ring)))
        self._draw("/picked", [(corners, PICKED_RGB)], 4.0)

    def show(self, film: Film, stamp_ns: int, shown: frozenset[str]) -> None:
        """Put everything where it was at a time; `shown` names what else than robots is wanted."""
        self._shadows.visible = "radio shadows" in shown
        for robot, rows in film.robots.items():
            self._show_robot(film, robot, row_at(rows, stamp_ns), stamp_ns)
        for vehicle, rows in zip(self._vehicles, film.vehicles, strict=True):
            row = row_at(rows, stamp_ns)
            vehicle.visible = row is not None
            if row is not None:
                vehicle.position = self._on_ground(row[1], row[2], vehicle.dimensions[2] / 2 + 0.2)
                vehicle.wxyz = _turned(row[3])
        self._draw("/trails", self._trails(film, stamp_ns) if "trails" in shown else [], 3.0)
        self._draw("/links", self._links(film, stamp_ns) if "radio links" in shown else [], 2.0)
        self._draw("/legs", self._legs(film, stamp_ns) if "patrol legs" in shown else [], 1.5)
        self._show_scans(film, stamp_ns, "last scan" in shown)

    def _show_robot(self, film: Film, robot: str, row: F64 | None, stamp_ns: int) -> None:
        marker = self._robots[robot]
        marker.visible = row is not None
        if row is None:
            return
        marker.position, marker.wxyz = row[1:4], _turned(row[YAW])
        waiting = film.waiting(robot, stamp_ns)
        silent = "" if row[RADIO] else " · no radio"
        text = f"{robot[-3:].lstrip('0')}{f' · {waiting} waiting' if waiting else ''}{silent}"
        if self._labels[robot].text != text:
            self._labels[robot].text = text

    def _show_scans(self, film: Film, stamp_ns: int, wanted: bool) -> None:
        for robot, cloud in self._scans.items():
            points_of = film.scans.get(robot)
            # Of a finished run the folder keeps the last scan alone: shown at its end.
            cloud.visible = wanted and points_of is not None and stamp_ns >= film.end_ns
            if cloud.visible and points_of is not None and (points := points_of()) is not self._drawn_scans.get(robot):
                self._drawn_scans[robot] = points
                cloud.points = points.astype(np.float32)

    def _trails(self, film: Film, stamp_ns: int) -> list[tuple[F64, tuple[int, int, int]]]:
        """A robot's way so far in its colour, in dark red where it had no radio."""
        out = []
        for robot, rows in film.robots.items():
            until = int(np.searchsorted(rows[:, 0], stamp_ns, "right"))
            kept = rows[: until : max(1, until // TRAIL_POINTS)]
            if until:
                kept = np.vstack([kept, rows[until - 1 : until]])
            way = kept[:, 1:4] + np.array([0, 0, 0.2 * self._big_m])
            segments, up = np.stack([way[:-1], way[1:]], 1), kept[1:, RADIO] > 0
            out += [(segments[up], self._rgb[robot]), (segments[~up], SILENT_RGB)]
        return out

    def _links(self, film: Film, stamp_ns: int) -> list[tuple[F64, tuple[int, int, int]]]:
        """From the base station to every robot that has radio."""
        found = (row_at(rows, stamp_ns) for rows in film.robots.values())
        ends = [row[1:4] + np.array([0, 0, 0.7 * self._big_m]) for row in found if row is not None and row[RADIO]]
        return [(np.array([(self._base_m, end) for end in ends]).reshape(-1, 2, 3), LINK_RGB)]

    def _legs(self, film: Film, stamp_ns: int) -> list[tuple[F64, tuple[int, int, int]]]:
        """Straight lines through the waypoints of each robot's mission."""
        out, patrol = [], self._site.scenario.patrol
        for robot, waypoints in film.legs(stamp_ns).items():
            way = np.array([self._on_ground(*patrol[i], 0.3 * self._big_m) for i in waypoints]).reshape(-1, 3)
            out.append((np.stack([way[:-1], way[1:]], 1), self._rgb[robot]))
        return out

    def _draw(self, name: str, lines: list[tuple[F64, tuple[int, int, int]]], width_px: float) -> None:
        points = np.concatenate([segments for segments, _ in lines] or [NO_SEGMENTS]).astype(np.float32)
        # The page takes a line's colours for linear ones.
        colours = [np.full((len(s), 2, 3), linear_bytes(np.array(rgb) / 255), np.uint8) for s, rgb in lines]
        rgb = np.concatenate(colours) if colours else np.zeros((0, 2, 3), np.uint8)
        drawn = self._lines.get(name)
        if drawn is not None and np.array_equal(drawn.points, points):
            return
        # Added anew under its name: its number of points is not what it was.
        self._lines[name] = self._scene.add_line_segments(
            name, points, rgb, thickness=width_px, thickness_units="screen"
        )


def _turned(yaw_rad: float) -> tuple[float, float, float, float]:
    return math.cos(yaw_rad / 2), 0.0, 0.0, math.sin(yaw_rad / 2)
