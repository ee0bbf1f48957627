"""What stands in a scenario's world: ground, buildings, and the loops of its vehicles."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import numpy.typing as npt

from orograph.arrays import F64
from orograph.scenario import Scenario
from orograph.scene.buildings import building_mesh
from orograph.scene.changes import solids, standing
from orograph.scene.mesh import Mesh, joined
from orograph.scene.terrain import ground_height_m, terrain_mesh
from orograph.scene.vehicles import Loop, rounded_loop


@dataclass(frozen=True, eq=False)
class Scene:
    """Static geometry of a scenario in the map frame, and where its vehicles drive."""

    scenario: Scenario
    building_meshes: tuple[Mesh, ...]
    loops: tuple[Loop, ...]

    @cached_property
    def terrain_mesh(self) -> Mesh:
        """Ground over the grid and its margin."""
        return terrain_mesh(self.scenario.terrain, self.scenario.grid.grid)

    @cached_property
    def building_mesh(self) -> Mesh:
        """All buildings as one mesh."""
        return joined(self.building_meshes)

    @cached_property
    def mesh(self) -> Mesh:
        """Ground and buildings as one mesh, ground first."""
        return joined([self.terrain_mesh, self.building_mesh])

    @cached_property
    def _building_bounds(self) -> F64:
        corners = [
            (*mesh.vertices[:, :2].min(axis=0), *mesh.vertices[:, :2].max(axis=0)) for mesh in self.building_meshes
        ]
        return np.array(corners, np.float64).reshape(-1, 4)

    def meshes_in(self, rectangle_m: tuple[float, float, float, float]) -> tuple[Mesh, Mesh]:
        """(ground, buildings) that touch (x_min, y_min, x_max, y_max): whole mesh cells, whole buildings."""
        west, south, east, north = rectangle_m
        x0, y0, x1, y1 = self._building_bounds.T
        touching = np.flatnonzero((x0 <= east) & (x1 >= west) & (y0 <= north) & (y1 >= south))
        ground = terrain_mesh(self.scenario.terrain, self.scenario.grid.grid, rectangle_m)
        return ground, joined([self.building_meshes[i] for i in touching])

    def height_m(self, x_m: npt.ArrayLike, y_m: npt.ArrayLike) -> F64:
        """Exact height of the ground [m], without buildings, at points of any common shape."""
        return ground_height_m(self.scenario.terrain, x_m, y_m)

    def vehicle_loop_length_m(self, index: int) -> float:
        """Length of a vehicle's loop."""
        return self.loops[index].length_m

    def vehicle_pose(self, index: int, distance_m: float) -> tuple[float, float, float, float]:
        """(x, y, z of the ground, yaw) of a vehicle at a distance along its loop; start_fraction is not added here."""
        x, y, yaw = self.loops[index].at(distance_m)
        return x, y, float(self.height_m(x, y)), yaw


def build_scene(scenario: Scenario, stamp_ns: int = 0) -> Scene:
    """Build all static geometry as it stands at a time; raises ValueError that names what never makes sense."""
    meshes = {}
    for name, thing in solids(scenario).items():
        with _naming(name):
            meshes[name] = building_mesh(thing, scenario.terrain)
    loops = []
    for i, vehicle in enumerate(scenario.vehicles):
        with _naming(f"vehicles[{i}]"):
            loops.append(rounded_loop(vehicle.loop))
    return Scene(scenario, tuple(meshes[name] for name in standing(scenario, stamp_ns)), tuple(loops))


@contextmanager
def _naming(place: str) -> Iterator[None]:
    try:
        yield
    except ValueError as error:
        raise ValueError(f"{place}: {error}") from error
