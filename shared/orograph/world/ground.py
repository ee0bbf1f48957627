"""The static part of the world as one DART skeleton, and poses as DART takes them.

dartpy builds a mesh shape only from a file, so the triangles pass through a temporary one.
"""

from __future__ import annotations

import tempfile
from pathlib import Path

import dartpy as dart
import numpy as np
import numpy.typing as npt

from orograph.arrays import F64
from orograph.scene import Mesh
from orograph.scene.mesh import joined

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
    """By hand: trimesh, which would write it too, takes 0.6 s to import."""
    faces = np.empty(len(mesh.faces), PLY_FACE)
    faces["corners"], faces["vertices"] = 3, mesh.faces
    header = (
        f"ply\nformat binary_little_endian 1.0\nelement vertex {len(mesh.vertices)}\n"
        "property float x\nproperty float y\nproperty float z\n"
        f"element face {len(mesh.faces)}\nproperty list uchar int vertex_indices\nend_header\n"
    )
    return header.encode() + mesh.vertices.astype("<f4").tobytes() + faces.tobytes()


def isometry(R: F64, position_m: npt.ArrayLike) -> dart.math.Isometry3:
    """DART's form of a pose."""
    transform = dart.math.Isometry3()
    transform.set_rotation(R)
    transform.set_translation(np.asarray(position_m, np.float64))
    return transform
