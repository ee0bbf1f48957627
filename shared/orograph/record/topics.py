"""The topics of a record, each a channel; stamps are simulation time, coordinates metres in the frame `map`."""

from __future__ import annotations

import numpy as np
from foxglove import Channel, Context, Schema
from foxglove.channels import FrameTransformsChannel, GridChannel, LogChannel, PointCloudChannel
from foxglove.messages import (
    FrameTransform,
    FrameTransforms,
    Grid,
    Log,
    LogLevel,
    PackedElementField,
    PackedElementFieldNumericType,
    PointCloud,
    Pose,
    Quaternion,
    Timestamp,
    Vector2,
    Vector3,
)  # fmt: skip

from orograph.arrays import F64
from orograph.layers import CellMap

MAP = "map"
FLOAT = PackedElementFieldNumericType.Float32
UPRIGHT = Quaternion(x=0, y=0, z=0, w=1)
Body = tuple[str, F64, F64]
"""Frame, position (3,) [m], quaternion w, x, y, z (4,)."""
RAW = "msgpack"
"""Encoding of the protocol's own messages, as `comms/wire.py` packs them; their topic is their Zenoh key."""


class Topics:
    """Writes into whatever is open on `context`."""

    def __init__(self, context: Context) -> None:
        self._context = context
        self._grid = GridChannel("/map/grid", context=context)
        self._surface = PointCloudChannel("/map/surface", context=context)
        self._tf = FrameTransformsChannel("/tf", context=context)
        self._events = LogChannel("/events", context=context)
        self._scans: dict[str, PointCloudChannel] = {}
        self._plain: dict[str, Channel] = {}

    def bodies(self, stamp_ns: int, bodies: list[Body]) -> None:
        """Where frames are in the map."""
        transforms = [
            FrameTransform(
                timestamp=_stamp(stamp_ns), parent_frame_id=MAP, child_frame_id=frame,
                translation=Vector3(x=float(p[0]), y=float(p[1]), z=float(p[2])),
                rotation=Quaternion(w=float(q[0]), x=float(q[1]), y=float(q[2]), z=float(q[3])),
            )
            for frame, p, q in bodies
        ]  # fmt: skip
        self._tf.log(FrameTransforms(transforms=transforms), log_time=stamp_ns)

    def map(self, stamp_ns: int, cells: CellMap, top_m: F64) -> None:
        """All layers as a grid, and the upper surface as a cloud of cells' centres."""
        grid, names = cells.grid, [name for name, _ in cells.layers()]
        data = np.stack([layer for _, layer in cells.layers()], axis=-1).astype("<f4")
        x0, y0 = grid.origin_m
        self._grid.log(
            Grid(
                timestamp=_stamp(stamp_ns), frame_id=MAP, column_count=grid.cols,
                pose=Pose(position=Vector3(x=x0, y=y0, z=0.0), orientation=UPRIGHT),
                cell_size=Vector2(x=grid.cell_m, y=grid.cell_m), cell_stride=4 * len(names),
                row_stride=4 * len(names) * grid.cols, fields=_fields(names), data=data.tobytes(),
            ),
            log_time=stamp_ns,
        )  # fmt: skip
        points = np.stack([*np.meshgrid(*grid.centres_m()), top_m, cells.confidence, cells.occupation], axis=-1)
        known = np.isfinite(top_m)
        self._surface.log(_cloud(stamp_ns, points[known], ["confidence", "occupation"]), log_time=stamp_ns)

    def scan(self, stamp_ns: int, robot: str, points_m: F64) -> None:
        """Points (n, 3) of a scan in the map frame."""
        if robot not in self._scans:
            self._scans[robot] = PointCloudChannel(f"/scan/{robot}", context=self._context)
        self._scans[robot].log(_cloud(stamp_ns, points_m, []), log_time=stamp_ns)

    def event(self, stamp_ns: int, who: str, line: str) -> None:
        """One line that a service noted."""
        self._events.log(
            Log(timestamp=_stamp(stamp_ns), level=LogLevel.Info, message=line, name=who), log_time=stamp_ns
        )  # fmt: skip

    def figures(self, stamp_ns: int, node: str, figures: dict[str, float]) -> None:
        """A node's figures, as JSON."""
        self._channel(f"/figures/{node}", None).log(figures, log_time=stamp_ns)

    def raw(self, stamp_ns: int, key: str, payload: bytes) -> None:
        """One message of the protocol as it travelled."""
        self._channel(key, RAW).log(payload, log_time=stamp_ns)

    def _channel(self, topic: str, encoding: str | None) -> Channel:
        """By default of JSON."""
        if topic not in self._plain:
            schema = Schema(name="orograph", encoding="", data=b"") if encoding else None
            self._plain[topic] = Channel(topic, message_encoding=encoding, schema=schema, context=self._context)
        return self._plain[topic]


def _stamp(stamp_ns: int) -> Timestamp:
    return Timestamp(sec=stamp_ns // 10**9, nsec=stamp_ns % 10**9)


def _fields(names: list[str]) -> list[PackedElementField]:
    return [PackedElementField(name=name, offset=4 * i, type=FLOAT) for i, name in enumerate(names)]


def _cloud(stamp_ns: int, points: F64, more: list[str]) -> PointCloud:
    names = ["x", "y", "z", *more]
    return PointCloud(
        timestamp=_stamp(stamp_ns), frame_id=MAP, point_stride=4 * len(names), fields=_fields(names),
        pose=Pose(position=Vector3(x=0, y=0, z=0), orientation=UPRIGHT), data=points.astype("<f4").tobytes(),
    )  # fmt: skip
