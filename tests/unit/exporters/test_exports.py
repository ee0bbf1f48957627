"""Maps in other tools' files, read back by other hands than those that wrote them, cell by cell."""

from __future__ import annotations

import json
import sqlite3
import struct
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from orograph.errors import InputError
from orograph.exporters.chart import Chart
from orograph.exporters.formats import FORMATS, export
from orograph.grid import Grid
from orograph.layers import KINDS, CellMap

ORIGIN_M = (385_000.0, 6_672_000.0)


@pytest.fixture
def chart() -> Chart:
    """14 x 9 cells with a wall, an unknown corner and a roof over unknown ground, somewhere in Finland."""
    random, grid = np.random.default_rng(7), Grid((0.0, 0.0), 0.5, (9, 14))
    layers = dict(CellMap.unknown(grid).by_name)
    layers["height"] = random.uniform(-3, 900, grid.shape).astype(np.float32)
    layers["gradient_x"] = layers["gradient_y"] = random.uniform(-1, 1, grid.shape).astype(np.float32)
    layers["occupation"] = random.uniform(0, 1, grid.shape).astype(np.float32)
    layers["confidence"] = random.integers(1, 255, grid.shape).astype(np.float32)
    layers["height_top"] = np.full(grid.shape, np.nan, np.float32)
    layers["confidence_top"] = np.zeros(grid.shape, np.float32)
    layers["height_top"][4, 2:6], layers["confidence_top"][4, 2:6] = 905.5, 77
    for name in ("height", "gradient_x", "gradient_y", "occupation"):
        layers[name][:3, :4] = np.nan
    layers["confidence"][:3, :4] = 0
    layers["height"][4, 3], layers["confidence"][4, 3] = np.nan, 0
    return Chart(CellMap(grid, layers), "EPSG:32635", ORIGIN_M, stamp_ns=1_700_000_000_250_000_000)


def written(chart: Chart, form: str, out: Path) -> list[Path]:
    return list(export([chart], "glrm", [form], out))


def expected(chart: Chart, name: str) -> np.ndarray:
    """A layer as it should be told: NaN where nothing is known, for what mapping finds out."""
    layer = chart.cells.by_name[name].copy()
    nothing = (chart.cells.confidence == 0) & (chart.cells.by_name["confidence_top"] == 0)
    if KINDS[name].wire:
        layer[nothing] = np.nan
    return layer


@pytest.mark.parametrize("form", ["geotiff", "cog"])
def test_a_geotiff_by_another_library(chart: Chart, tmp_path: Path, form: str) -> None:
    import tifffile

    (path,) = written(chart, form, tmp_path)
    with tifffile.TiffFile(path) as file:
        page = file.pages[0]
        data = page.asarray()  # type: ignore[union-attr]
        told = page.tags["GDAL_METADATA"].value  # type: ignore[union-attr]
        place = file.geotiff_metadata
        assert page.tags["GDAL_NODATA"].value == "nan"  # type: ignore[union-attr]
    data = np.moveaxis(data, -1, 0) if data.shape[-1] == len(chart.layers()) else data
    for band, (name, layer) in enumerate(chart.cells.layers()):
        assert np.array_equal(data[band][::-1], expected(chart, name), equal_nan=True), name
        assert f'role="description">{name}<' in told and layer is not None
    assert 'role="unittype">m<' in told
    assert place is not None and place["ProjectedCSTypeGeoKey"] == 32635
    assert place["ModelPixelScale"][:2] == [0.5, 0.5]
    assert place["ModelTiepoint"][3:5] == [ORIGIN_M[0], ORIGIN_M[1] + 9 * 0.5]


def test_map_servers_load_the_picture(chart: Chart, tmp_path: Path) -> None:
    from PIL import Image

    picture, words = written(chart, "pgm", tmp_path)
    told = yaml.safe_load(words.read_text())
    assert told["image"] == picture.name and told["origin"] == [*ORIGIN_M, 0.0] and told["resolution"] == 0.5
    with Image.open(tmp_path / told["image"]) as image:
        share = (255 - np.asarray(image, np.float64)) / 255  # negate: 0
    loaded = np.where(share > told["occupied_thresh"], 100, np.where(share < told["free_thresh"], 0, -1))[::-1]
    occupation = expected(chart, "occupation")
    with np.errstate(invalid="ignore"):
        wanted = np.where(np.isnan(occupation), -1, np.where(occupation >= 0.5, 100, 0))
    assert np.array_equal(loaded, wanted)


def test_npz_says_where_it_lies(chart: Chart, tmp_path: Path) -> None:
    (path,) = written(chart, "npz", tmp_path)
    with np.load(path, allow_pickle=False) as held:
        assert tuple(held["origin_m"]) == ORIGIN_M and held["cell_m"] == 0.5 and str(held["crs"]) == "EPSG:32635"
        for name, _ in chart.cells.layers():
            assert np.array_equal(held[name], expected(chart, name), equal_nan=True)


def tops(chart: Chart) -> dict[tuple[int, int], float]:
    """(row, col) -> the upper surface [m]."""
    top, height = expected(chart, "height_top"), expected(chart, "height")
    found = {}
    for row, col in np.ndindex(chart.grid.shape):
        z = top[row, col] if np.isfinite(top[row, col]) else height[row, col]
        if np.isfinite(z):
            found[row, col] = float(z)
    return found


def assert_same_surface(chart: Chart, vertices: np.ndarray, triangles: np.ndarray) -> None:
    places = {(round(y / 0.5 - 0.5), round(x / 0.5 - 0.5)): z for x, y, z in vertices.tolist()}
    assert places == pytest.approx(tops(chart), abs=1e-3)
    a, b, c = (vertices[triangles[:, i]] for i in range(3))
    normals = np.cross(b - a, c - a)
    assert (normals[:, 2] > 0).all(), "seen from above"
    squares = sum(all((r + i, q + j) in places for i in (0, 1) for j in (0, 1)) for r, q in places)
    assert squares * 2 <= len(triangles) and normals[:, 2].sum() / 2 == pytest.approx(len(triangles) * 0.125)


def test_ply_as_the_format_says(chart: Chart, tmp_path: Path) -> None:
    (path,) = written(chart, "ply", tmp_path)
    head, _, body = path.read_bytes().partition(b"end_header\n")
    lines = head.decode().splitlines()
    assert f"comment origin {ORIGIN_M[0]!r} {ORIGIN_M[1]!r} crs EPSG:32635" in lines
    assert lines[1] == "format binary_little_endian 1.0"
    counts = {line.split()[1]: int(line.split()[2]) for line in lines if line.startswith("element")}
    kinds = {"float": "<f4", "uchar": "u1"}
    columns = [line.split()[1:] for line in lines if line.startswith("property") and "list" not in line]
    vertex = np.dtype([(name, kinds[kind]) for kind, name in columns])
    vertices = np.frombuffer(body, vertex, counts["vertex"])
    faces = np.frombuffer(body, [("n", "u1"), ("v", "<i4", 3)], counts["face"], counts["vertex"] * vertex.itemsize)
    assert (faces["n"] == 3).all() and len({*map(tuple, vertices[["red", "green", "blue"]].tolist())}) > 20
    assert_same_surface(chart, np.column_stack([vertices[a] for a in "xyz"]).astype(float), faces["v"])


def test_glb_as_the_format_says(chart: Chart, tmp_path: Path) -> None:
    (path,) = written(chart, "glb", tmp_path)
    raw = path.read_bytes()
    magic, version, length, size = struct.unpack_from("<4sIII", raw)
    assert (magic, version, length) == (b"glTF", 2, len(raw))
    tree, binary = json.loads(raw[20 : 20 + size]), raw[28 + size :]

    def accessor(number: int) -> np.ndarray[Any, Any]:
        about = tree["accessors"][number]
        view = tree["bufferViews"][about["bufferView"]]
        kind = {5126: "<f4", 5125: "<u4", 5121: "u1"}[about["componentType"]]
        wide = {"SCALAR": 1, "VEC3": 3, "VEC4": 4}[about["type"]]
        start = view.get("byteOffset", 0) + about.get("byteOffset", 0)
        return np.frombuffer(binary, kind, about["count"] * wide, start).reshape(-1, wide)

    part = tree["meshes"][0]["primitives"][0]
    points = accessor(part["attributes"]["POSITION"]).astype(float)
    root = np.eye(4)
    for node in tree["nodes"]:
        if "matrix" in node:
            root = root @ np.array(node["matrix"]).reshape(4, 4).T
    east, up, south = (points @ root[:3, :3].T + root[:3, 3]).T
    assert_same_surface(chart, np.column_stack([east, -south, up]), accessor(part["indices"]).reshape(-1, 3))
    assert tree["scenes"][0]["extras"] == {"origin_m": list(ORIGIN_M), "crs": "EPSG:32635"}
    assert "COLOR_0" in part["attributes"]


def las_points(raw: bytes) -> tuple[np.ndarray, np.ndarray]:
    """Coordinates (n, 3) and (class, confidence, occupation) of a LAS 1.4 file, by the format's description."""
    assert raw[:4] == b"LASF" and raw[24:26] == b"\x01\x04" and raw[104] == 6
    start, length = struct.unpack_from("<I", raw, 96)[0], struct.unpack_from("<H", raw, 105)[0]
    (count,) = struct.unpack_from("<Q", raw, 247)
    scale, offset = np.frombuffer(raw, "<f8", 3, 131), np.frombuffer(raw, "<f8", 3, 155)
    kind = np.dtype({"names": ["xyz", "class", "confidence", "occupation"], "formats": ["3<i4", "u1", "u1", "<f4"],
                     "offsets": [0, 16, 30, 31], "itemsize": length})  # fmt: skip
    points = np.frombuffer(raw, kind, count, start)
    return points["xyz"] * scale + offset, points


def test_las_as_the_format_says_and_laz_alike(chart: Chart, tmp_path: Path) -> None:
    import laspy

    (path,), (packed,) = written(chart, "las", tmp_path), written(chart, "laz", tmp_path)
    xyz, points = las_points(path.read_bytes())
    assert b"WGS 84 / UTM zone 35N" in path.read_bytes()
    found = {}
    for (x, y, z), point in zip(xyz.tolist(), points, strict=True):
        row_col = round((y - ORIGIN_M[1]) / 0.5 - 0.5), round((x - ORIGIN_M[0]) / 0.5 - 0.5)
        found[row_col, "height" if point["class"] == 2 else "height_top"] = z
        sure = "confidence" if point["class"] == 2 else "confidence_top"
        assert point["confidence"] == chart.cells.by_name[sure][row_col]
    layers = {name: expected(chart, name) for name in ("height", "height_top")}
    places = list(np.ndindex(chart.grid.shape))
    wanted = {(at, name): float(z[at]) for name, z in layers.items() for at in places if np.isfinite(z[at])}
    assert found == pytest.approx(wanted, abs=1e-3)
    loose = laspy.read(packed)
    assert packed.stat().st_size < path.stat().st_size
    assert np.allclose(np.column_stack([loose.x, loose.y, loose.z]), xyz, atol=1e-6)


def test_mcap_by_another_library_and_the_folder_alike(chart: Chart, tmp_path: Path) -> None:
    from mcap.reader import make_reader
    from mcap_ros2.decoder import DecoderFactory

    (path,), (folder,) = written(chart, "mcap", tmp_path), written(chart, "rosbag2", tmp_path)
    with path.open("rb") as stream:
        read = list(make_reader(stream, decoder_factories=[DecoderFactory()]).iter_decoded_messages())
    told = {channel.topic: (message, decoded) for _, channel, message, decoded in read}
    (_, layered), (message, plain) = told["/grid_map"], told["/map"]
    assert message.log_time == chart.stamp_ns and plain.header.stamp.nanosec == 250_000_000
    info, rows, cols = layered.info, *chart.grid.shape
    for name, data in zip(layered.layers, layered.data, strict=True):
        layer = expected(chart, name)
        by_column, size = np.array(data.data, np.float32), data.layout.dim
        assert [d.label for d in size] == ["column_index", "row_index"] and size[1].size == cols
        for row, col in [(0, 13), (8, 0), (4, 2), (5, 7)]:
            # grid_map: index (0, 0) is the north-east corner, the first index goes against x, the second against y.
            x, y = ORIGIN_M[0] + (col + 0.5) * 0.5, ORIGIN_M[1] + (row + 0.5) * 0.5
            i = round((info.pose.position.x + info.length_x / 2 - x) / info.resolution - 0.5)
            j = round((info.pose.position.y + info.length_y / 2 - y) / info.resolution - 0.5)
            assert np.array_equal(by_column[j * size[1].size + i], layer[row, col], equal_nan=True)
    grid = np.array(plain.data, np.int8).reshape(rows, cols)
    occupation = expected(chart, "occupation")
    assert np.array_equal(grid, np.where(np.isnan(occupation), -1, np.round(100 * np.nan_to_num(occupation))))
    assert (plain.info.origin.position.x, plain.info.origin.position.y) == ORIGIN_M
    raw = {topic: bytes(message.data) for topic, (message, _) in told.items()}
    with sqlite3.connect(next(folder.glob("*.db3"))) as store:
        rows_in = store.execute("select name, data from messages join topics on topics.id = topic_id").fetchall()
    store.close()
    assert {name: bytes(data) for name, data in rows_in} == raw and (folder / "metadata.yaml").is_file()


def test_all_of_it_again_in_place_of_what_was_there(chart: Chart, tmp_path: Path) -> None:
    first = list(export([chart], "glrm", FORMATS, tmp_path))
    assert list(export([chart], "glrm", FORMATS, tmp_path)) == first
    assert sorted(tmp_path.iterdir()) == sorted(first) and len(first) == len(FORMATS) + 1


def test_a_map_of_nothing_is_told_so(tmp_path: Path) -> None:
    nothing = Chart(CellMap.unknown(Grid((0.0, 0.0), 5.0, (4, 4))))
    flat = [form for form in FORMATS if form not in ("ply", "glb")]
    assert len(list(export([nothing], "glrm", flat, tmp_path))) == len(flat) + 1
    with pytest.raises(InputError, match="no cell of the map has a height"):
        list(export([nothing], "glrm", ["glb"], tmp_path))


def test_unknown_frames_and_places_that_cannot_be_written(chart: Chart, tmp_path: Path) -> None:
    lost = Chart(chart.cells, "EPSG:99999999")
    with pytest.raises(InputError, match="crs EPSG:99999999: unknown to PROJ"):
        list(export([lost], "glrm", ["geotiff"], tmp_path))
    assert list(tmp_path.iterdir()) == []
    (tmp_path / "file").touch()
    with pytest.raises(InputError, match="cannot be written"):
        list(export([chart], "glrm", ["npz"], tmp_path / "file"))
