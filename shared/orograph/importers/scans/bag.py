"""ROS 1 and ROS 2 bags and MCAP: PointCloud2 of any layout, poses from TF and odometry."""

from __future__ import annotations

from collections.abc import Collection, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from orograph.importers.scans.fields import scan_of_fields
from orograph.importers.scans.scan import Scan, ScanError, first_line
from orograph.importers.scans.trajectory import Trajectory
from orograph.importers.scans.transforms import Frames

CLOUD, ODOMETRY = "sensor_msgs/msg/PointCloud2", "nav_msgs/msg/Odometry"
TF = ("tf2_msgs/msg/TFMessage", "tf/msg/tfMessage")
STATIC = "tf_static"
TYPES = {1: "i1", 2: "u1", 3: "i2", 4: "u2", 5: "i4", 6: "u4", 7: "f4", 8: "f8"}
"""PointField's datatypes."""


class BagScans:
    """The clouds of one topic; quick from first to last, any other order reads anew from the start."""

    in_map, crs, note = False, "", ""

    def __init__(self, path: Path, topic: str | None = None, posed: bool = False) -> None:
        """`posed`: poses come from elsewhere, none are looked for. Raises ScanError."""
        self.path = path
        with _opened(path) as reader:
            counts = [(c.topic, c.msgtype, c.msgcount) for c in reader.connections]
        self.topic = _topic_of_clouds(path, {topic: kind for topic, kind, _ in counts}, topic)
        self._count: int = sum(count for name, _, count in counts if name == self.topic)
        if not self._count:
            raise ScanError(f"{path}: {self.topic}: holds no clouds")
        self._at, self._clouds = 0, _messages(path, topics=(self.topic,))
        self.trajectory = None if posed else _trajectory(path, self._first_frame())

    def __len__(self) -> int:
        return self._count

    def __getitem__(self, index: int) -> Scan:
        if not 0 <= index < self._count:
            raise IndexError(index)
        if index < self._at:
            self._at, self._clouds = 0, _messages(self.path, topics=(self.topic,))
        for _, cloud in self._clouds:
            self._at += 1
            if self._at == index + 1:
                where = f"{self.path}: {self.topic}: cloud {index + 1}"
                return scan_of_fields(where, _table(where, cloud), _ns(cloud.header.stamp))
        raise ScanError(f"{self.path}: {self._count} clouds promised, {self._at} are there; it is cut off")

    def _first_frame(self) -> str:
        first = next(_messages(self.path, topics=(self.topic,)), None)
        if first is None:
            raise ScanError(f"{self.path}: {self._count} clouds promised, none are there; it is cut off")
        return str(first[1].header.frame_id)


@contextmanager
def _opened(path: Path) -> Iterator[Any]:
    """A reader of the bag; whatever the library raises on a broken one becomes a ScanError."""
    from rosbags.highlevel import AnyReader
    from rosbags.typesys import Stores, get_typestore

    try:
        with AnyReader([path], default_typestore=get_typestore(Stores.ROS2_HUMBLE)) as reader:
            yield reader
    except (ScanError, GeneratorExit):
        raise
    except Exception as error:
        raise ScanError(f"{path}: no bag that can be read: {first_line(error)[:160]}") from None


def _messages(path: Path, topics: Collection[str] = (), kinds: Collection[str] = ()) -> Iterator[tuple[str, Any]]:
    """(topic, message) of some topics or kinds, by time."""
    with _opened(path) as reader:
        wanted = [c for c in reader.connections if c.topic in topics or c.msgtype in kinds]
        for connection, _, raw in reader.messages(connections=wanted) if wanted else ():
            yield connection.topic, reader.deserialize(raw, connection.msgtype)


def _topic_of_clouds(path: Path, found: dict[str, str], asked: str | None) -> str:
    clouds = [name for name, kind in found.items() if kind == CLOUD]
    if asked in clouds or (asked is None and len(clouds) == 1):
        return asked or clouds[0]
    listed = ", ".join(f"{name} ({kind.split('/')[-1]})" for name, kind in sorted(found.items())) or "nothing"
    if asked is not None:
        raise ScanError(f"{path}: --topic {asked}: no PointCloud2 there; it holds {listed}")
    what = f"{len(clouds)} topics of PointCloud2; choose one by --topic" if clouds else "no PointCloud2"
    raise ScanError(f"{path}: {what}; it holds {listed}")


def _trajectory(path: Path, sensor: str) -> Trajectory:
    """The way of the sensor's frame; odometry is asked only where TF does not tell, and one topic of it is enough."""
    frames, odometry = Frames(), dict[str, tuple[str, list[Any]]]()
    for topic, message in _messages(path, kinds=(*TF, ODOMETRY)):
        if hasattr(message, "transforms"):
            for told in message.transforms:
                stamp_ns = None if topic.endswith(STATIC) else _ns(told.header.stamp)
                place = _numbers(told.transform.translation, "xyz") + _numbers(told.transform.rotation, "xyzw")
                frames.add(told.child_frame_id, told.header.frame_id, stamp_ns, place)
            continue
        first_topic, told_so = odometry.setdefault(message.child_frame_id, (topic, []))
        if topic == first_topic:
            told_so.append(message)
    for child, (_, told_so) in odometry.items():
        for told in told_so if frames.parent(child.lstrip("/")) is None else ():
            pose = told.pose.pose
            place = _numbers(pose.position, "xyz") + _numbers(pose.orientation, "xyzw")
            frames.add(child, told.header.frame_id, _ns(told.header.stamp), place)
    try:
        return frames.trajectory(sensor)
    except ScanError as error:
        raise ScanError(f"{path}: {error}") from None


def _table(where: str, cloud: Any) -> np.ndarray[Any, Any]:
    """The cloud's fields (n,) as its own layout says, rows without their padding."""
    order = ">" if cloud.is_bigendian else "<"
    fields = [f for f in cloud.fields if f.datatype in TYPES and f.count == 1]
    layout = {
        "names": [f.name for f in fields], "formats": [order + TYPES[f.datatype] for f in fields],
        "offsets": [f.offset for f in fields], "itemsize": cloud.point_step,
    }  # fmt: skip
    used = cloud.width * cloud.point_step
    if cloud.row_step < used or len(cloud.data) != cloud.row_step * cloud.height:
        size = f"{len(cloud.data)} bytes for {cloud.height} x {cloud.row_step}"
        raise ScanError(f"{where}: data: {size}, {used} of a row used; the driver's row_step or the bag is wrong")
    try:
        kind = np.dtype(layout)  # type: ignore[call-overload]
        rows = np.asarray(cloud.data, np.uint8).reshape(cloud.height, cloud.row_step)[:, :used]
        return np.ascontiguousarray(rows).reshape(-1).view(kind)
    except (ValueError, TypeError) as error:
        raise ScanError(f"{where}: fields: {error}") from None


def _ns(stamp: Any) -> int:
    return int(stamp.sec) * 10**9 + int(stamp.nanosec)


def _numbers(of: Any, axes: str) -> tuple[float, ...]:
    return tuple(float(getattr(of, axis)) for axis in axes)
