"""Recordings as other tools write them, made from a small scene: writers that share nothing with the readers."""

from __future__ import annotations

import struct
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

F64 = npt.NDArray[np.float64]


def scene(seed: int = 1, count: int = 4000) -> F64:
    """Points (n, 3) [m] as a sensor 1.5 m over a yard sees them: ground at -1.5, a wall at x = 20."""
    random = np.random.default_rng(seed)
    ground = np.column_stack([random.uniform(-30, 19, count), random.uniform(-30, 30, count), np.full(count, -1.5)])
    wall = np.column_stack([np.full(count // 4, 20.0), random.uniform(-30, 30, count // 4),
                            random.uniform(-1.5, 3, count // 4)])  # fmt: skip
    return np.concatenate([ground, wall]).astype(np.float32).astype(np.float64)


def kitti(path: Path, points: F64) -> None:
    np.column_stack([points, np.zeros(len(points))]).astype("<f4").tofile(path)


def nuscenes(path: Path, points: F64) -> None:
    np.column_stack([points, np.zeros((len(points), 2))]).astype("<f4").tofile(path)


def _pcd_header(points: F64, data: str) -> str:
    return (f"# .PCD v0.7 - Point Cloud Data file format\nVERSION 0.7\nFIELDS x y z intensity\nSIZE 4 4 4 4\n"
            f"TYPE F F F F\nCOUNT 1 1 1 1\nWIDTH {len(points)}\nHEIGHT 1\nVIEWPOINT 0 0 0 1 0 0 0\n"
            f"POINTS {len(points)}\nDATA {data}\n")  # fmt: skip


def pcd_ascii(path: Path, points: F64) -> None:
    path.write_text(_pcd_header(points, "ascii") + "".join(f"{x!r} {y!r} {z!r} 7\n" for x, y, z in points.tolist()))


def pcd_binary(path: Path, points: F64) -> None:
    body = np.column_stack([points, np.zeros(len(points))]).astype("<f4").tobytes()
    path.write_bytes(_pcd_header(points, "binary").encode() + body)


def pcd_compressed(path: Path, points: F64) -> None:
    import lzf

    body = np.column_stack([points, np.zeros(len(points))]).astype("<f4").T.tobytes()
    packed = lzf.compress(body)
    sizes = struct.pack("<II", len(packed), len(body))
    path.write_bytes(_pcd_header(points, "binary_compressed").encode() + sizes + packed)


def ply(order: str) -> Callable[[Path, F64], None]:
    def write(path: Path, points: F64) -> None:
        name = {"<": "binary_little_endian", ">": "binary_big_endian", "": "ascii"}[order]
        head = (f"ply\nformat {name} 1.0\ncomment made up\nelement vertex {len(points)}\nproperty float x\n"
                "property float y\nproperty float z\nproperty uchar red\nend_header\n")  # fmt: skip
        if not order:
            path.write_text(head + "".join(f"{x!r} {y!r} {z!r} 9\n" for x, y, z in points.tolist()))
            return
        rows = np.zeros(len(points), [(axis, f"{order}f4") for axis in "xyz"] + [("red", "u1")])
        for i, axis in enumerate("xyz"):
            rows[axis] = points[:, i]
        path.write_bytes(head.encode() + rows.tobytes())

    return write


def npz(path: Path, points: F64) -> None:
    np.savez(path, points=points)


def xyz(path: Path, points: F64) -> None:
    path.write_text("// made up\n" + "".join(f"{x!r} {y!r} {z!r} 255 0 0\n" for x, y, z in points.tolist()))


def csv(path: Path, points: F64) -> None:
    path.write_text('\ufeffID,Z,"X",Y [m]\r\n' + "".join(f"1,{z!r},{x!r},{y!r}\r\n" for x, y, z in points.tolist()))


def las(path: Path, points: F64, crs: str = "EPSG:32635", scale: float = 1e-4) -> None:
    import laspy
    import pyproj

    header = laspy.LasHeader(point_format=6, version="1.4")
    header.scales, header.offsets = np.full(3, scale), np.floor(points.min(axis=0))
    if crs:
        header.add_crs(pyproj.CRS(crs))
    file = laspy.LasData(header)
    file.x, file.y, file.z = points.T
    file.write(str(path))


def tum(path: Path, stamps_s: Sequence[str], poses: Sequence[F64]) -> None:
    from scipy.spatial.transform import Rotation

    rows = [(s, *T[:3, 3], *Rotation.from_matrix(T[:3, :3]).as_quat()) for s, T in zip(stamps_s, poses, strict=True)]
    path.write_text("# time x y z qx qy qz qw\n" + "".join(" ".join(map(str, row)) + "\n" for row in rows))


def turned(x_m: float, y_m: float, yaw_rad: float, z_m: float = 0.0) -> F64:
    """A pose (4, 4) on the plane."""
    c, s = np.cos(yaw_rad), np.sin(yaw_rad)
    return np.array([[c, -s, 0, x_m], [s, c, 0, y_m], [0, 0, 1, z_m], [0, 0, 0, 1.0]])


def cloud2(points: F64, times_s: F64 | None = None, big: bool = False) -> dict[str, Any]:
    """A PointCloud2's fields but its header: x, y, z as doubles not in order, padded rows, an organised cloud."""
    order = ">" if big else "<"
    kind = np.dtype({"names": ["intensity", "z", "x", "y", "t"], "formats": [f"{order}f4", *[f"{order}f8"] * 3,
                     f"{order}u4"], "offsets": [0, 8, 16, 24, 36], "itemsize": 48})  # fmt: skip
    rows = np.zeros(len(points), kind)
    rows["x"], rows["y"], rows["z"] = points.T
    rows["t"] = 0 if times_s is None else np.round(times_s * 1e9)
    height, padding = 2, 16
    assert len(points) % height == 0
    data = np.zeros((height, len(points) // height * 48 + padding), np.uint8)
    data[:, :-padding] = rows.view(np.uint8).reshape(height, -1)
    fields = [("intensity", 0, 7, 1), ("z", 8, 8, 1), ("x", 16, 8, 1), ("y", 24, 8, 1), ("t", 36, 6, 1)]
    return {"height": height, "width": len(points) // height, "fields": fields, "is_bigendian": big, "point_step": 48,
            "row_step": data.shape[1], "data": data.reshape(-1), "is_dense": True}  # fmt: skip
