"""Embree, which embreex's wheel brings: our own device on it, and meshes that rays meet, eight rays at a time.

embreex itself lets Embree take the widest vectors that a CPU has, and casts one ray after another. Here every CPU is
told the same instructions, and the rays of a ring, which lie beside each other, go through the tree together. Embree
only says which face a ray meets; how far away that is comes from the face's plane, in float64. Embree's own distances
rest on the CPU's approximate reciprocals, which differ by its instructions and by its maker.
"""

from __future__ import annotations

import ctypes
import weakref
from pathlib import Path
from typing import Any

import embreex
import numpy as np
import numpy.typing as npt
from numba import njit, types

from orograph.arrays import F32, F64, I32
from orograph.scene import Mesh

LANES = 8
"""Rays in a packet: as many float32 as an AVX2 register holds."""
_ROW_BYTES, _ROWS = 4 * LANES, 24
_NEAR, _FAR, _MASK, _FACE, _MESH = 3, 8, 9, 17, 18
"""Rows of RTCRayHit8, whose origins and directions begin at 0 and 4: the ray's ends, and what it hit of which mesh."""
_VALID, _ARGUMENTS = 21, 22
"""Rows behind it: which lanes are rays, and RTCIntersectArguments."""

_TRIANGLE, _INDEX, _VERTEX, _UINT3, _FLOAT3 = 0, 0, 1, 0x5003, 0x9003
_ROBUST = 1 << 2
"""Costs 15 %, but without it one in ten rays aimed at an edge that two faces share slips through."""
_COHERENT = 1 << 16
_ALL = np.uint32(0xFFFFFFFF)
"""Of lanes, of features, of a mask; as a mesh: none."""


def _library() -> ctypes.CDLL:
    """libembree4 of the installed wheel, its symbols visible to compiled kernels; ImportError where it is not there."""
    site = Path(embreex.__file__).parents[1]
    found = sorted([*site.glob("embreex.libs/libembree4*"), *site.glob("embreex/.dylibs/libembree4*")])
    if not found:
        raise ImportError(f"no libembree4 in {site / 'embreex.libs'}; reinstall it: pip install 'orograph[laser]'")
    library = ctypes.CDLL(str(found[0]), mode=ctypes.RTLD_GLOBAL)
    pointer, number, size = ctypes.c_void_p, ctypes.c_int, ctypes.c_size_t
    for name, result, *arguments in (
        ("rtcNewDevice", pointer, ctypes.c_char_p), ("rtcReleaseDevice", None, pointer),
        ("rtcGetDeviceError", number, pointer),
        ("rtcNewScene", pointer, pointer), ("rtcReleaseScene", None, pointer),
        ("rtcSetSceneFlags", None, pointer, number), ("rtcCommitScene", None, pointer),
        ("rtcNewGeometry", pointer, pointer, number), ("rtcReleaseGeometry", None, pointer),
        ("rtcSetNewGeometryBuffer", pointer, pointer, number, ctypes.c_uint, number, size, size),
        ("rtcCommitGeometry", None, pointer), ("rtcAttachGeometry", ctypes.c_uint, pointer, pointer),
    ):  # fmt: skip
        function = getattr(library, name)
        function.restype, function.argtypes = result, arguments
    return library


_LIBRARY = _library()
_intersect8: Any = types.ExternalFunction("rtcIntersect8", types.void(types.intp, types.intp, types.intp, types.intp))
"""For kernels: addresses of the valid lanes, of the scene, of the packet and of the arguments."""


class Device:
    """Embree at one level of a CPU's instructions; one thread builds, so that every host builds the same tree."""

    def __init__(self, isa: str = "avx2") -> None:
        # The frequency level, too, would else depend on the CPU's model, and with it the width of the tree.
        settings = f"threads=1,max_isa={isa},frequency_level=simd256"
        self.address = _LIBRARY.rtcNewDevice(settings.encode())
        assert self.address, f"Embree does not start with {settings}: error {_LIBRARY.rtcGetDeviceError(None)}"
        weakref.finalize(self, _LIBRARY.rtcReleaseDevice, self.address)


class Solid:
    """A mesh, relative to `origin_m`, ready for rays."""

    def __init__(self, device: Device, mesh: Mesh, origin_m: F64) -> None:
        vertices = mesh.vertices - origin_m
        self._scene = _LIBRARY.rtcNewScene(device.address)
        weakref.finalize(self, _LIBRARY.rtcReleaseScene, self._scene)
        _LIBRARY.rtcSetSceneFlags(self._scene, _ROBUST)
        geometry = _LIBRARY.rtcNewGeometry(device.address, _TRIANGLE)
        _fill(geometry, _VERTEX, _FLOAT3, vertices.astype(np.float32))
        _fill(geometry, _INDEX, _UINT3, mesh.faces.astype(np.uint32))
        _LIBRARY.rtcCommitGeometry(geometry)
        _LIBRARY.rtcAttachGeometry(self._scene, geometry)
        _LIBRARY.rtcReleaseGeometry(geometry)
        _LIBRARY.rtcCommitScene(self._scene)
        error = _LIBRARY.rtcGetDeviceError(device.address)
        assert not error, f"Embree's error {error} with {len(mesh.faces)} faces"
        a, b, c = (vertices[mesh.faces[:, i]] for i in range(3))
        normals = np.cross(b - a, c - a)
        # Normals, not of unit length, and their products with a point of the face.
        self._planes = np.concatenate([normals, (normals * a).sum(axis=1, keepdims=True)], axis=1)
        self._packet = _packet()

    def meet(self, origins_m: F64, rays: F32, reach_m: float, faces: I32, away_m: F64) -> None:
        """Set `faces` (n,) to the nearest on each ray and `away_m` (n,) to its distance; -1, inf where none in reach.

        Unit directions (3, n), n a multiple of 8; origins (3, n), or (3, 1) for all. One thread at a time.
        """
        assert rays.shape == (3, len(faces)) and len(faces) == len(away_m) and not len(faces) % LANES, rays.shape
        _meet_faces(self._scene, self._planes, self._packet, origins_m, rays, reach_m, faces, away_m)


def _fill(geometry: int, kind: int, layout: int, rows: npt.NDArray[np.float32] | npt.NDArray[np.uint32]) -> None:
    buffer = _LIBRARY.rtcSetNewGeometryBuffer(geometry, kind, 0, layout, rows.itemsize * 3, len(rows))
    ctypes.memmove(buffer, np.ascontiguousarray(rows).ctypes.data, rows.nbytes)


def _packet() -> npt.NDArray[np.uint32]:
    """A block (24, 8) for eight rays, aligned as Embree wants it: RTCRayHit8, all lanes valid, coherent rays."""
    block = np.zeros(_ROWS * LANES + LANES, np.uint32)
    first = -block.ctypes.data % _ROW_BYTES // block.itemsize
    words = block[first : first + _ROWS * LANES].reshape(_ROWS, LANES)
    words[_VALID] = words[_MASK] = _ALL
    words[_ARGUMENTS, :2] = _COHERENT, _ALL
    return words


@njit(cache=True, error_model="numpy")  # a ray along a plane divides by zero, and meets nothing
def _meet_faces(
    solid: int, planes: F64, words: npt.NDArray[np.uint32], origins_m: F64, rays: F32, reach_m: float,
    faces: I32, away_m: F64,
) -> None:  # fmt: skip
    """`Solid.meet` with what a compiled loop must be told: addresses, planes, and the packet's block."""
    many, floats, block = origins_m.shape[1] > 1, words.view(np.float32), words.ctypes.data
    reach = np.float32(reach_m)
    for lane in range(LANES):
        floats[0, lane], floats[1, lane], floats[2, lane] = origins_m[0, 0], origins_m[1, 0], origins_m[2, 0]
        floats[_NEAR, lane] = 0
    for first in range(0, rays.shape[1], LANES):
        for lane in range(LANES):
            i = first + lane
            floats[4, lane], floats[5, lane], floats[6, lane] = rays[0, i], rays[1, i], rays[2, i]
            floats[_FAR, lane], words[_MESH, lane] = reach, _ALL
        if many:
            for lane in range(LANES):
                i = first + lane
                floats[0, lane], floats[1, lane], floats[2, lane] = origins_m[0, i], origins_m[1, i], origins_m[2, i]
        _intersect8(block + _VALID * _ROW_BYTES, solid, block, block + _ARGUMENTS * _ROW_BYTES)
        for lane in range(LANES):
            faces[first + lane] = np.int32(words[_FACE, lane]) if words[_MESH, lane] != _ALL else -1
    for i in range(rays.shape[1]):
        face, origin = np.uint64(max(faces[i], 0)), i if many else 0
        a, b, c = planes[face, 0], planes[face, 1], planes[face, 2]
        left = planes[face, 3] - (a * origins_m[0, origin] + b * origins_m[1, origin] + c * origins_m[2, origin])
        distance_m = left / (a * rays[0, i] + b * rays[1, i] + c * rays[2, i])
        away_m[i] = distance_m if (faces[i] >= 0) & (distance_m > 0) & (distance_m < reach_m) else np.inf
