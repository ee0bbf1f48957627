"""Triangle meshes as two arrays, and how they are joined."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from orograph.arrays import F64, I32


@dataclass(frozen=True, eq=False)
class Mesh:
    """Vertices (n, 3) float64 [m] and faces (m, 3) int32, counter-clockwise seen from outside."""

    vertices: F64
    faces: I32

    def __post_init__(self) -> None:
        assert self.vertices.dtype == np.float64 and self.vertices.shape[1:] == (3,), self.vertices.shape
        assert self.faces.dtype == np.int32 and self.faces.shape[1:] == (3,), self.faces.shape


def joined(meshes: Sequence[Mesh]) -> Mesh:
    """One mesh that holds all of them in order; vertices are not merged."""
    if not meshes:
        return Mesh(np.zeros((0, 3)), np.zeros((0, 3), np.int32))
    starts = np.cumsum([0, *(len(mesh.vertices) for mesh in meshes[:-1])])
    faces = [mesh.faces + start for mesh, start in zip(meshes, starts, strict=True)]
    return Mesh(np.concatenate([mesh.vertices for mesh in meshes]), np.concatenate(faces).astype(np.int32))
