"""The static part of the world as one DART skeleton, and how a body stands on the ground.

dartpy builds a mesh shape only from a file, so the triangles pass through a temporary one.
"""

from __future__ import annotations

import math
import tempfile
from pathlib import Path

import dartpy as dart
import numpy as np
import numpy.typing as npt

from orograph.arrays import F64
from orograph.scene import Mesh, Scene
from orograph.scene.mesh import joined

Vector = tuple[float, float, float]

KEEL_DEPTH_M = 50.0
PLY_FACE = np.dtype([("corners", "u1"), ("vertices", "<i4", (3,))])
URDF = """<robot name="ground"><link name="ground"><collision><geometry><mesh filename="file://{path}"/>
</geometry></collision></link></robot>"""


def ground_skeleton(mesh: Mesh) -> dart.dynamics.Skeleton:
    """An immobile skeleton with one Bullet triangle mesh: ground and buildings, in the map frame."""
    mesh = joined([mesh, _keel(mesh)])
    with tempfile.TemporaryDirectory(prefix="orograph-") as folder:
        path = Path(folder) / "ground.ply"
        path.write_bytes(_binary_ply(mesh))
        skeleton = dart.utils.DartLoader().parseSkeletonString(URDF.format(path=path), dart.common.Uri("file:///"))
    assert skeleton is not None, "DART could not load the ground"
    skeleton.setMobile(False)
    return skeleton


def _keel(mesh: Mesh) -> Mesh:
    """A tetrahedron far below the ground: it keeps DART from taking a plane or a bowl for a convex body.

    A convex mesh becomes the hull of all its vertices: 50 times slower, and no ground for who stands in the hollow.
    """
    low, high = mesh.vertices.min(axis=0), mesh.vertices.max(axis=0)
    tip = np.array([*(0.5 * (low + high))[:2], low[2] - KEEL_DEPTH_M])
    corners = tip + np.array([[1.0, 0.0, 0.0], [-0.5, 0.9, 0.0], [-0.5, -0.9, 0.0], [0.0, 0.0, -1.0]])
    return Mesh(corners, np.array([[0, 1, 2], [0, 3, 1], [1, 3, 2], [2, 3, 0]], np.int32))


def _binary_ply(mesh: Mesh) -> bytes:
    faces = np.empty(len(mesh.faces), PLY_FACE)
    faces["corners"], faces["vertices"] = 3, mesh.faces
    header = (
        f"ply\nformat binary_little_endian 1.0\nelement vertex {len(mesh.vertices)}\n"
        "property float x\nproperty float y\nproperty float z\n"
        f"element face {len(mesh.faces)}\nproperty list uchar int vertex_indices\nend_header\n"
    )
    return header.encode() + mesh.vertices.astype("<f4").tobytes() + faces.tobytes()


def standing_rotation(scene: Scene, x_m: float, y_m: float, yaw_rad: float, size_m: tuple[float, float]) -> F64:
    """R_map_body (3, 3) of a body of length and width `size_m` that stands on the ground with this heading."""
    half_length, half_width = 0.5 * size_m[0], 0.5 * size_m[1]
    c, s = math.cos(yaw_rad), math.sin(yaw_rad)
    x_places = x_m + np.array([c * half_length, -c * half_length, -s * half_width, s * half_width])
    y_places = y_m + np.array([s * half_length, -s * half_length, c * half_width, -c * half_width])
    ahead, behind, left, right = scene.height_m(x_places, y_places).tolist()
    rise, climb = (ahead - behind) / size_m[0], (left - right) / size_m[1]
    x_length, z_length = math.sqrt(1 + rise * rise), math.sqrt(1 + rise * rise + climb * climb)
    x_axis = c / x_length, s / x_length, rise / x_length
    # (c, s, rise) x (-s, c, climb)
    z_axis = (s * climb - c * rise) / z_length, (-s * rise - c * climb) / z_length, 1 / z_length
    return np.array([x_axis, _cross(z_axis, x_axis), z_axis]).T


def _cross(a: Vector, b: Vector) -> Vector:
    """`np.cross` of two plain vectors, which costs fifty times as much."""
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


def isometry(R: F64, position_m: npt.ArrayLike) -> dart.math.Isometry3:
    """DART's form of a pose."""
    transform = dart.math.Isometry3()
    transform.set_rotation(R)
    transform.set_translation(np.asarray(position_m, np.float64))
    return transform
