"""A ROS 2 bag, of SQLite or MCAP, with the map as grid_map_msgs/GridMap and nav_msgs/OccupancyGrid."""

from __future__ import annotations

import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from orograph.exporters.chart import Chart

GRID_MAP, OCCUPANCY_GRID = "grid_map_msgs/msg/GridMap", "nav_msgs/msg/OccupancyGrid"
TOPICS = {"/grid_map": GRID_MAP, "/map": OCCUPANCY_GRID}
DEFINITIONS = {
    "grid_map_msgs/msg/GridMapInfo": "float64 resolution\nfloat64 length_x\nfloat64 length_y\ngeometry_msgs/Pose pose",
    GRID_MAP: "std_msgs/Header header\ngrid_map_msgs/GridMapInfo info\nstring[] layers\nstring[] basic_layers\n"
    "std_msgs/Float32MultiArray[] data\nuint16 outer_start_index\nuint16 inner_start_index",
}
"""Of messages that do not come with ROS itself."""


def write_folder(path: Path, charts: Sequence[Chart]) -> None:
    """A bag as ROS 2 records it: a folder with its metadata, the map at each of its times."""
    from rosbags.rosbag2 import StoragePlugin

    _write(path, charts, StoragePlugin.SQLITE3)


def write_mcap(path: Path, charts: Sequence[Chart]) -> None:
    """The same as one MCAP file."""
    from rosbags.rosbag2 import StoragePlugin

    with tempfile.TemporaryDirectory(dir=path.parent) as scratch:
        folder = Path(scratch) / path.stem
        _write(folder, charts, StoragePlugin.MCAP)
        next(folder.glob("*.mcap")).rename(path)


def _write(folder: Path, charts: Sequence[Chart], plugin: Any) -> None:
    from rosbags.rosbag2 import Writer
    from rosbags.typesys import Stores, get_types_from_msg, get_typestore

    store = get_typestore(Stores.ROS2_HUMBLE)
    for name, text in DEFINITIONS.items():
        store.register(get_types_from_msg(text, name))
    made = {GRID_MAP: grid_map, OCCUPANCY_GRID: occupancy_grid}
    with Writer(folder, version=8, storage_plugin=plugin) as writer:
        connections = {kind: writer.add_connection(topic, kind, typestore=store) for topic, kind in TOPICS.items()}
        for chart in charts:
            for kind, connection in connections.items():
                writer.write(connection, chart.stamp_ns, store.serialize_cdr(made[kind](store, chart), kind))


def grid_map(store: Any, chart: Chart) -> Any:
    """GridMap: each layer column by column, from the north-east corner on towards the west, then south."""
    types, grid, layers = store.types, chart.grid, chart.layers()
    size, label = types["std_msgs/msg/MultiArrayDimension"], ("column_index", "row_index")
    # Its rows go with x and its columns with y, both backwards.
    rows, cols = grid.cols, grid.rows
    layout = types["std_msgs/msg/MultiArrayLayout"](
        dim=[size(label=label[0], size=cols, stride=rows * cols), size(label=label[1], size=rows, stride=rows)],
        data_offset=0,
    )  # fmt: skip
    data = [
        types["std_msgs/msg/Float32MultiArray"](
            layout=layout, data=np.ascontiguousarray(values[::-1, ::-1]).reshape(-1)
        )
        for _, _, values in layers
    ]
    x0, y0, x1, y1 = grid.extent_m
    info = types["grid_map_msgs/msg/GridMapInfo"](
        resolution=grid.cell_m, length_x=x1 - x0, length_y=y1 - y0, pose=_pose(store, (x0 + x1) / 2, (y0 + y1) / 2)
    )
    return types[GRID_MAP](
        header=_header(store, chart), info=info, layers=[name for name, _, _ in layers],
        basic_layers=["height"], data=data, outer_start_index=0,
        inner_start_index=0,
    )  # fmt: skip


def occupancy_grid(store: Any, chart: Chart) -> Any:
    """OccupancyGrid: 0 to 100, -1 unknown, row by row from the south-west corner."""
    types, grid, occupation = store.types, chart.grid, chart.cells.occupation
    told = chart.known & np.isfinite(occupation)
    cells = np.where(told, np.round(100 * np.nan_to_num(occupation)), -1).astype(np.int8)
    info = types["nav_msgs/msg/MapMetaData"](
        map_load_time=_time(store, chart), resolution=grid.cell_m, width=grid.cols, height=grid.rows,
        origin=_pose(store, *grid.origin_m),
    )  # fmt: skip
    return types[OCCUPANCY_GRID](header=_header(store, chart), info=info, data=cells.reshape(-1))


def _header(store: Any, chart: Chart) -> Any:
    return store.types["std_msgs/msg/Header"](stamp=_time(store, chart), frame_id=chart.frame)


def _time(store: Any, chart: Chart) -> Any:
    sec, nanosec = divmod(chart.stamp_ns, 10**9)
    return store.types["builtin_interfaces/msg/Time"](sec=sec, nanosec=nanosec)


def _pose(store: Any, x_m: float, y_m: float) -> Any:
    types = store.types
    return types["geometry_msgs/msg/Pose"](
        position=types["geometry_msgs/msg/Point"](x=x_m, y=y_m, z=0.0),
        orientation=types["geometry_msgs/msg/Quaternion"](x=0.0, y=0.0, z=0.0, w=1.0),
    )
