"""Bags with clouds, transforms and odometry: ROS 1 and ROS 2 by `rosbags`, MCAP by `mcap-ros2-support`."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from made_up.recordings import F64, cloud2
from rosbags.rosbag1 import Writer as Writer1
from rosbags.rosbag2 import StoragePlugin
from rosbags.rosbag2 import Writer as Writer2
from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from scipy.spatial.transform import Rotation

Said = tuple[str, str, int, Any]
"""Topic, type, time [ns], content as plain values."""
CLOUD, TF, ODOMETRY = "sensor_msgs/msg/PointCloud2", "tf2_msgs/msg/TFMessage", "nav_msgs/msg/Odometry"


def header(stamp_ns: int, frame: str) -> dict[str, Any]:
    return {"stamp": {"sec": stamp_ns // 10**9, "nanosec": stamp_ns % 10**9}, "frame_id": frame}


def cloud(stamp_ns: int, frame: str, points: F64, times_s: F64 | None = None, big: bool = False) -> Said:
    fields = [{"name": n, "offset": o, "datatype": d, "count": c} for n, o, d, c in cloud2(points)["fields"]]
    return "/points", CLOUD, stamp_ns, {"header": header(stamp_ns, frame), **cloud2(points, times_s, big),
                                        "fields": fields}  # fmt: skip


def transform(stamp_ns: int, parent: str, child: str, pose: F64, static: bool = False) -> Said:
    said = {"header": header(stamp_ns, parent), "child_frame_id": child,
            "transform": {"translation": _xyz(pose), "rotation": _xyzw(pose)}}  # fmt: skip
    return "/tf_static" if static else "/tf", TF, stamp_ns, {"transforms": [said]}


def odometry(stamp_ns: int, parent: str, child: str, pose: F64) -> Said:
    still = {"linear": {"x": 0.0, "y": 0.0, "z": 0.0}, "angular": {"x": 0.0, "y": 0.0, "z": 0.0}}
    with_covariance = {"pose": {"position": _xyz(pose), "orientation": _xyzw(pose)}, "covariance": np.zeros(36)}
    said = {"header": header(stamp_ns, parent), "child_frame_id": child, "pose": with_covariance,
            "twist": {"twist": still, "covariance": np.zeros(36)}}  # fmt: skip
    return "/odom", ODOMETRY, stamp_ns, said


def _xyz(pose: F64) -> dict[str, float]:
    return dict(zip("xyz", pose[:3, 3].tolist(), strict=True))


def _xyzw(pose: F64) -> dict[str, float]:
    return dict(zip("xyzw", Rotation.from_matrix(pose[:3, :3]).as_quat().tolist(), strict=True))


def _by_rosbags(said: Sequence[Said], store: Any, writer: Any, serialize: Callable[[Any, str], Any]) -> None:
    with writer:
        connections: dict[str, Any] = {}
        for topic, kind, stamp_ns, content in said:
            if topic not in connections:
                connections[topic] = writer.add_connection(topic, kind, typestore=store)
            writer.write(connections[topic], stamp_ns, serialize(_typed(store, kind, content), kind))


def _typed(store: Any, kind: str, content: Any) -> Any:
    """A message object of plain values, by the store's own description of its fields."""
    if kind == "std_msgs/msg/Header" and "seq" in dict(store.fielddefs[kind][1]):
        content = {"seq": 0, **content}
    fields = {}
    for name, (node, about) in store.fielddefs[kind][1]:
        value = content[name]
        if node == 2:  # a message within
            value = _typed(store, about, value)
        elif node != 1 and about[0][0] == 2:
            value = [_typed(store, about[0][1], v) for v in value]
        fields[name] = value
    return store.types[kind](**fields)


def ros1(path: Path, said: Sequence[Said]) -> None:
    store = get_typestore(Stores.ROS1_NOETIC)
    store.register(get_types_from_msg("geometry_msgs/TransformStamped[] transforms", TF))
    _by_rosbags(said, store, Writer1(path), store.serialize_ros1)


def ros2(path: Path, said: Sequence[Said]) -> None:
    store = get_typestore(Stores.ROS2_HUMBLE)
    writer = Writer2(path, version=9, storage_plugin=StoragePlugin.SQLITE3)
    _by_rosbags(said, store, writer, store.serialize_cdr)


def mcap(path: Path, said: Sequence[Said]) -> None:
    from mcap_ros2.writer import Writer

    store = get_typestore(Stores.ROS2_HUMBLE)
    with path.open("wb") as stream:
        writer, schemas = Writer(stream), {}
        for topic, kind, stamp_ns, content in said:
            if kind not in schemas:
                schemas[kind] = writer.register_msgdef(kind, store.generate_msgdef(kind, ros_version=2)[0])
            writer.write_message(topic, schemas[kind], _plain(content), stamp_ns, stamp_ns)
        writer.finish()


def _plain(content: Any) -> Any:
    if isinstance(content, dict):
        return {k: _plain(v) for k, v in content.items()}
    if isinstance(content, np.ndarray):
        return content.tobytes() if content.dtype == np.uint8 else content.tolist()
    return [_plain(v) for v in content] if isinstance(content, list) else content
