"""The map in the page's scene: a node per tile, and only tiles that look different are sent again."""

from __future__ import annotations

from typing import Any

import numpy as np
import trimesh
import viser

from orograph.console.colours import Look, Scale, linear_bytes
from orograph.console.surface import Mesh, Surface, tiles, touched
from orograph.grid import Grid

COLOUR_STEP = 1 / 64
"""Colours that differ by less look the same: an age that grows need not be sent at every picture."""


class Relief:
    """Draws looks of one grid; a tile's new node is there before the old one goes, so that nothing flickers."""

    def __init__(self, scene: viser.SceneApi, grid: Grid) -> None:
        self._scene, self._grid, self._tiles = scene, grid, tiles(grid)
        self._height_m = np.full(grid.shape, np.inf)
        self._rgb = np.full((*grid.shape, 3), np.inf)
        self._shown: dict[tuple[int, int], viser.GlbHandle] = {}
        self._leaving: list[viser.GlbHandle] = []
        self._turn = dict.fromkeys(self._tiles, 0)
        self.sent_bytes = 0

    def show(self, look: Look, scale: Scale) -> None:
        """Draw the map as a scale has it; `settle` before the next."""
        height_m, rgb = np.asarray(scale.surface(look), np.float64), np.round(scale.rgb(look) / COLOUR_STEP)
        moved = ~((height_m == self._height_m) | (np.isnan(height_m) & np.isnan(self._height_m)))
        changed = moved | (rgb != self._rgb).any(axis=-1)
        if not changed.any():
            return
        self._height_m, self._rgb = height_m, rgb
        surface = Surface(self._grid, height_m)
        for place in touched(changed):
            self._send(place, surface.mesh(*self._tiles[place]))

    def settle(self) -> None:
        """Take away what has been replaced, a picture later than what replaces it came."""
        for node in self._leaving:
            node.remove()
        self._leaving.clear()

    def _send(self, place: tuple[int, int], mesh: Mesh) -> None:
        self._turn[place] = 1 - self._turn[place]
        if old := self._shown.pop(place, None):
            self._leaving.append(old)
        if len(mesh.faces):
            rgb = self._rgb.reshape(-1, 3)[mesh.cells] * COLOUR_STEP * mesh.light[:, None]
            glb = as_glb(mesh, rgb)
            self.sent_bytes += len(glb)
            name = f"/map/{place[0]}-{place[1]}-{self._turn[place]}"
            self._shown[place] = self._scene.add_glb(name, glb, cast_shadow=False, receive_shadow=False)


def as_glb(mesh: Mesh, rgb: Any) -> bytes:
    """A glTF file of a mesh with colours (v, 3) 0..1 as they are, without the page's lamps."""
    colours = np.full((len(rgb), 4), 255, np.uint8)
    colours[:, :3] = linear_bytes(np.clip(rgb, 0, 1))
    solid = trimesh.Trimesh(mesh.vertices, mesh.faces, vertex_colors=colours, process=False)
    return bytes(trimesh.Scene(solid).export(file_type="glb", tree_postprocessor=_unlit))  # type: ignore[no-untyped-call]


def _unlit(tree: dict[str, Any]) -> None:
    tree["materials"] = [{"extensions": {"KHR_materials_unlit": {}}, "doubleSided": True}]
    tree["extensionsUsed"] = ["KHR_materials_unlit"]
    for mesh in tree["meshes"]:
        for part in mesh["primitives"]:
            part["material"] = 0
