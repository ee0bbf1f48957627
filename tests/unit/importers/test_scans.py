"""Readers of recorded scans: each format against a writer of another hand, poses, moving sensors, and bad input."""

from __future__ import annotations

import math
import random
from contextlib import suppress
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from made_up import bags, recordings
from made_up.recordings import turned
from orograph.errors import InputError
from orograph.importers.scans import ScanError, Trajectory, open_scans
from orograph.importers.scans.fields import times_ns
from orograph.importers.scans.odometry import by_kiss_icp
from orograph.importers.scans.opened import open_recordings
from orograph.importers.scans.posed import Placed
from orograph.importers.scans.trajectory import sensor_pose

SECOND = 10**9
START_NS = 1_532_402_927 * SECOND
POINTS = recordings.scene()
WRITERS = {
    "kitti.bin": recordings.kitti, "n015__LIDAR_TOP__1532402927647951.pcd.bin": recordings.nuscenes,
    "ascii.pcd": recordings.pcd_ascii, "binary.pcd": recordings.pcd_binary,
    "compressed.pcd": recordings.pcd_compressed, "little.ply": recordings.ply("<"), "big.ply": recordings.ply(">"),
    "ascii.ply": recordings.ply(""), "scan.npz": recordings.npz, "scan.xyz": recordings.xyz,
    "scan.csv": recordings.csv, "tile.las": recordings.las, "tile.laz": recordings.las,
}  # fmt: skip


@pytest.mark.parametrize("name", WRITERS)
def test_what_others_write_is_read(tmp_path: Path, name: str) -> None:
    WRITERS[name](tmp_path / name, POINTS)
    scans = open_scans(tmp_path / name)
    assert len(scans) == 1
    assert np.abs(scans[0].points - POINTS).max() <= 1e-4
    assert scans.in_map == name.endswith(("las", "laz"))
    assert ("32635" in scans.crs) == scans.in_map
    if "nuscenes" in name:
        assert scans[0].stamp_ns == 1_532_402_927_647_951_000


@pytest.mark.parametrize("name", ["scan.pcd", "scan.ply", "scan.npz", "scan.las"])
def test_contents_speak_before_names(tmp_path: Path, name: str) -> None:
    writer = {"pcd": recordings.pcd_binary, "ply": recordings.ply("<"), "npz": recordings.npz, "las": recordings.las}
    writer[name.split(".")[1]](tmp_path / name, POINTS)
    path = (tmp_path / name).rename(tmp_path / "scan.dat")
    assert np.abs(open_scans(path)[0].points - POINTS).max() <= 1e-4


def said(points: np.ndarray, clouds: int = 5) -> list[bags.Said]:
    """A robot that turns as it drives, its lidar half a metre ahead of its middle and 1.2 m above."""
    out = [bags.transform(START_NS, "base", "lidar", turned(0.5, 0, 0, 1.2), static=True)]
    for i in range(clouds):
        stamp_ns = START_NS + i * SECOND // 10
        out.append(bags.odometry(stamp_ns, "odom", "base", turned(i, 0, 0.1 * i)))
        out.append(bags.cloud(stamp_ns, "lidar", points, big=i % 2 == 1))
    return out


@pytest.mark.parametrize(("name", "writer"), [("a.bag", bags.ros1), ("b", bags.ros2), ("c.mcap", bags.mcap)])
def test_bags_hold_clouds_of_any_layout_and_the_lidars_way(tmp_path: Path, name: str, writer: object) -> None:
    points = POINTS[:500]
    writer(tmp_path / name, said(points))  # type: ignore[operator]
    scans = open_scans(tmp_path / name)
    assert [scans[i].stamp_ns for i in (4, 0, 2)] == [START_NS + i * SECOND // 10 for i in (4, 0, 2)]
    assert all(np.array_equal(scans[i].points, points) for i in range(len(scans)))
    assert scans.trajectory is not None
    for i, pose in enumerate(scans.trajectory.poses):
        wanted = turned(i + 0.5 * math.cos(0.1 * i), 0.5 * math.sin(0.1 * i), 0.1 * i, 1.2)
        assert np.allclose(pose, wanted, atol=1e-12)


def test_tf_is_followed_to_the_map_and_told_better_than_odometry(tmp_path: Path) -> None:
    moving = [bags.transform(START_NS + i * SECOND, "odom", "base", turned(2.0 * i, 0, 0)) for i in range(3)]
    slow = [bags.transform(START_NS + i * 2 * SECOND, "map", "odom", turned(0, 10.0 * i, 0)) for i in range(2)]
    wrong = [bags.odometry(START_NS, "odom", "base", turned(99, 99, 0))]
    clouds = [bags.cloud(START_NS + SECOND, "base", POINTS[:4])]
    bags.mcap(tmp_path / "tf.mcap", [*moving, *slow, *wrong, *clouds])
    trajectory = open_scans(tmp_path / "tf.mcap").trajectory
    assert trajectory is not None
    assert np.allclose(trajectory.at(np.array([START_NS + SECOND // 2]))[0, :3, 3], (1.0, 2.5, 0.0))


def placed(source: Path, poses: Path | None = None, mount: str = "0,0,0", box: tuple[float, ...] = ()) -> list[Placed]:
    ((_, _, scans),) = open_recordings([source], poses, None, None, None, sensor_pose(mount), box)
    found = [scans[i] for i in range(len(scans))]
    return [scan for scan in found if scan is not None]


def test_tum_poses_go_by_time_and_the_mount_is_turned_with_the_robot(tmp_path: Path) -> None:
    (tmp_path / "scans").mkdir()
    for stamp in ("1532402927.100000", "1532402927.350000"):
        recordings.pcd_binary(tmp_path / "scans" / f"{stamp}.pcd", POINTS)
    poses = [turned(0, 0, 0), turned(10, 0, math.pi / 2), turned(10, 10, math.pi / 2)]
    recordings.tum(tmp_path / "tum.txt", ["1532402927.1", "1532402927.3", "1532402927.4"], poses)
    first, second = placed(tmp_path / "scans", tmp_path / "tum.txt", "1,0,2")
    assert np.allclose(first.points, POINTS + np.array([1, 0, 2]))
    assert np.allclose(second.position_m, (10, 6, 2))
    assert np.allclose(second.points[0], (10 - POINTS[0, 1], 6 + POINTS[0, 0], 2 + POINTS[0, 2]))
    assert (first.stamp_ns, second.stamp_ns) == (START_NS + SECOND // 10, START_NS + 35 * SECOND // 100)


def test_kitti_poses_are_of_the_camera_and_calib_says_where_that_is(tmp_path: Path) -> None:
    (tmp_path / "velodyne").mkdir()
    for i in range(3):
        recordings.kitti(tmp_path / "velodyne" / f"00000{i}.bin", POINTS)
    # The camera looks along the laser's x: its z; and it moves 2 m ahead and 1 m to the right a scan.
    (tmp_path / "poses.txt").write_text("".join(f"1 0 0 {i} 0 1 0 0 0 0 1 {2 * i}\n" for i in range(3)))
    (tmp_path / "calib.txt").write_text("P0: 1 2\nTr: 0 -1 0 0.1 0 0 -1 -0.2 1 0 0 -0.3\n")
    (tmp_path / "times.txt").write_text("0.0\n1.036e-01\n0.2073\n")
    found = placed(tmp_path)
    assert np.allclose([scan.position_m for scan in found], [(0, 0, 0), (2, -1, 0), (4, -2, 0)])
    assert [scan.stamp_ns for scan in found] == [0, 103_600_000, 207_300_000]


def test_a_moving_sensor_sees_a_straight_wall_straight(tmp_path: Path) -> None:
    """Points measured at 10 m/s and 2 rad/s during 0.1 s, against the wall that they were measured at."""
    generator, count = np.random.default_rng(3), 2000
    times_s = np.sort(generator.uniform(0, 0.1, count))
    times_s[0], times_s[-1] = 0, 0.1
    wall = np.column_stack([np.full(count, 25.0), generator.uniform(-20, 20, count), generator.uniform(0, 4, count)])
    poses = [turned(10 * t, 3.0, 2 * t) for t in times_s]
    seen = np.array([T[:3, :3].T @ (p - T[:3, 3]) for T, p in zip(poses, wall, strict=True)])
    way = [
        bags.transform(START_NS + i * SECOND // 100, "map", "lidar", turned(0.1 * i, 3.0, 0.02 * i)) for i in range(12)
    ]
    bags.mcap(tmp_path / "moving.mcap", [*way, bags.cloud(START_NS, "lidar", seen, times_s)])
    (scan,) = placed(tmp_path / "moving.mcap")
    assert np.abs(scan.points - wall).max() < 0.002
    bent = seen @ poses[0][:3, :3].T + poses[0][:3, 3]
    assert np.abs(bent - wall).max() > 1, "the test sees nothing"


def test_odometry_finds_the_way_through_a_yard_of_boxes(tmp_path: Path) -> None:
    """0.8 m and 2 degrees a scan; the sensor 1.7 m up and turned by 90 degrees on its carrier."""
    generator = np.random.default_rng(8)
    ground = np.column_stack([generator.uniform(-40, 40, (9000, 2)), np.zeros(9000)])
    corners = generator.uniform(-30, 30, (25, 2))
    sides = np.concatenate([
        np.column_stack([x + 4 * share, np.full(300, y), up, y + 4 * share, np.full(300, x), up])
        for x, y in corners for share, up in [generator.uniform(0, 1, (2, 300)) * [[1], [4]]]
    ])  # fmt: skip
    world = np.concatenate([ground, sides[:, [0, 1, 2]], sides[:, [4, 3, 5]]])
    mount = sensor_pose("0.3,0,1.7,0,0,90")
    poses = [turned(0.8 * i, 0.02 * i * i, math.radians(2 * i)) for i in range(6)]
    for i, pose in enumerate(poses):
        T = np.linalg.inv(pose @ mount)
        seen = world[generator.random(len(world)) < 0.8] @ T[:3, :3].T + T[:3, 3]
        recordings.npz(tmp_path / f"{i}.npz", seen + generator.normal(0, 0.01, seen.shape))
    found = by_kiss_icp(open_scans(tmp_path), mount, 1.0, 60.0, lambda *_: None)
    assert np.abs(found.poses - np.array(poses)).max() < 0.06


@given(st.sampled_from([("f8", 1.0), ("f8", 1e3), ("f8", 1e9), ("u4", 1e6), ("u4", 1e9), ("u8", 1e9)]), st.booleans(),
       st.floats(0.002, 0.9))  # fmt: skip
@settings(max_examples=60, deadline=None)
def test_times_are_of_whatever_unit_spans_a_scan(form: tuple[str, float], absolute: bool, span_s: float) -> None:
    kind, per_second = form
    absolute &= (kind != "u4" and per_second > 1e6) or (absolute and per_second == 1.0)
    offsets_s = np.linspace(0, span_s, 50)
    raw = offsets_s * per_second + ((START_NS / 1e9) * per_second if absolute else 0)
    found = times_ns(raw.astype(kind), START_NS)
    assert found is not None
    # float64 Unix time holds 0.25 us, as nanoseconds 256 ns; whole microseconds 1 us.
    assert np.abs(found[1] / 1e9 - offsets_s).max() < 2e-6


@given(st.lists(st.floats(0, 100), min_size=2, max_size=20, unique=True), st.floats(0, 1))
@settings(max_examples=40, deadline=None)
def test_between_two_poses_it_turns_and_moves_evenly(stamps_s: list[float], share: float) -> None:
    stamps_ns = np.unique([round(s * 1e9) for s in stamps_s])
    trajectory = Trajectory(stamps_ns, [turned(s / 1e9, -s / 1e9, s / 1e11) for s in stamps_ns.tolist()])
    at_ns = round(stamps_ns[0] + share * (stamps_ns[-1] - stamps_ns[0]))
    assert np.allclose(trajectory.at(np.array([at_ns]))[0], turned(at_ns / 1e9, -at_ns / 1e9, at_ns / 1e11), atol=1e-7)


def test_the_robot_itself_is_left_out_in_its_own_frame(tmp_path: Path) -> None:
    recordings.npz(tmp_path / "scan.npz", np.array([[0.0, 0, -1], [3, 0, -1], [0, 0.9, -1], [0, 0, 5]]))
    (scan,) = placed(tmp_path / "scan.npz", None, "1,0,2", (-1, -1, 0, 2, 1, 2))
    assert scan.self_box == 2 and np.allclose(scan.points, [(4, 0, 1), (1, 0, 7)])


BAD = {
    "no such": ("nowhere.pcd", None, "nowhere.pcd: no such file or folder"),
    "empty": ("empty.pcd", b"", "is empty"),
    "cut off": ("cut.bin", b"\0" * 100, "100 bytes are not rows of 4 numbers"),
    "other columns": ("five.bin", np.full((4, 5), 1e30, "<f4").tobytes(), "try another --format"),
    "not a pcd": ("x.pcd", b"# .PCD v0.7\nFIELDS x\n", "no PCD that can be read"),
    "no field": ("x.pcd", b"VERSION 0.7\nFIELDS x y\nSIZE 4 4\nTYPE F F\nCOUNT 1 1\nWIDTH 1\nHEIGHT 1\nPOINTS 1\n"
                 b"DATA ascii\n1 2\n", "no field z; it has x, y"),
    "not a ply": ("x.ply", b"ply\nnonsense", "no PLY that can be read"),
    "not a las": ("x.las", b"LASF" + b"\0" * 50, "no LAS that can be read"),
    "not an npz": ("x.npz", b"PK\x03\x04nothing", "no npz that can be read"),
    "text of words": ("x.csv", b"a,b,c\n1,2,3\n", "no columns x, y, z; it has a, b, c"),
    "text with a hole": ("x.xyz", b"1 2 3\n1 two 3\n", "two"),
    "binary text": ("x.xyz", b"\xff\xfe\x00", "no text in UTF-8"),
    "unknown": ("x.foo", b"hello", "--format kitti|"),
    "not a bag": ("x.bag", b"#ROSBAG V2.0\n", "no bag that can be read"),
    "not an mcap": ("x.mcap", b"\x89MCAP0\r\n", "no bag that can be read"),
    "not a db": ("x.db3", b"SQLite format 3\0", "no bag that can be read"),
}  # fmt: skip


LEFT_OPEN = pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")
"""`rosbags` leaves broken files to the garbage collector."""


@LEFT_OPEN
@pytest.mark.parametrize("name", BAD)
def test_what_cannot_be_read_is_said_with_the_file(tmp_path: Path, name: str) -> None:
    file, content, words = BAD[name]
    if content is not None:
        (tmp_path / file).write_bytes(content)
    with pytest.raises(ScanError) as error:
        placed(tmp_path / file)
    assert words in str(error.value) and file in str(error.value) and "\n" not in str(error.value)


@pytest.mark.parametrize(("name", "at"), [("tile.las", 100), ("tile.las", 243), ("tile.laz", "chunks")])
def test_a_header_that_promises_billions_is_not_believed(tmp_path: Path, name: str, at: int | str) -> None:
    recordings.las(tmp_path / name, POINTS)
    raw = bytearray((tmp_path / name).read_bytes())
    if at == "chunks":
        points_at = int.from_bytes(raw[96:100], "little")
        at = int.from_bytes(raw[points_at : points_at + 8], "little") + 4
    assert isinstance(at, int)
    raw[at : at + 4] = b"\xff" * 4
    (tmp_path / name).write_bytes(raw)
    with pytest.raises(ScanError, match="tells of more records than there are"):
        open_scans(tmp_path / name)


def test_bags_without_the_topic_or_the_frame_list_what_there_is(tmp_path: Path) -> None:
    bags.mcap(tmp_path / "odom.mcap", [bags.odometry(1, "odom", "base", np.eye(4))])
    bags.mcap(tmp_path / "far.mcap", [bags.odometry(1, "odom", "base", np.eye(4)), bags.cloud(1, "lidar", POINTS[:4])])
    with pytest.raises(ScanError, match=r"no PointCloud2; it holds /odom \(Odometry\)"):
        open_scans(tmp_path / "odom.mcap")
    with pytest.raises(ScanError, match=r"frame lidar: no transform .* \(frames told of: base\); give --poses"):
        open_scans(tmp_path / "far.mcap")
    with pytest.raises(ScanError, match=r"--topic /laser: no PointCloud2 there; it holds /odom .*, /points"):
        open_scans(tmp_path / "far.mcap", topic="/laser")


@pytest.mark.parametrize(("poses", "words"), [
    (None, "2 scans and no poses: give --poses FILE"),
    ("1 0 0 0 0 1 0 0 0 0 1 0\n", "1 poses for 2 scans"),
    ("0 0 0 0 0 0 0 1\n", "the clocks do not overlap: scans are of 1532402927.000"),
    ("0 0 0 0 0 0 0 1\n1 2 3\n", r":2: expected 8 numbers \(TUM: .*found '1 2 3'"),
    ("0 0 0 0 0 0 0 0\n", "a quaternion of zeros is no rotation"),
    ("# none\n", "holds no poses"),
])  # fmt: skip
def test_scans_and_poses_that_do_not_fit(tmp_path: Path, poses: str | None, words: str) -> None:
    (tmp_path / "scans").mkdir()
    for i in range(2):
        recordings.pcd_binary(tmp_path / "scans" / f"153240292{7 + i}.000000.pcd", POINTS)
    if poses is not None:
        (tmp_path / "poses.txt").write_text(poses)
    with pytest.raises(InputError, match=words):
        placed(tmp_path / "scans", None if poses is None else tmp_path / "poses.txt")


@LEFT_OPEN
@pytest.mark.parametrize("name", [*WRITERS, "a.bag", "c.mcap"])
def test_damaged_files_are_read_or_refused_in_words(tmp_path: Path, name: str) -> None:
    path, points, draw = tmp_path / name, POINTS[:40], random.Random(name)
    if name in WRITERS:
        WRITERS[name](path, points)
    else:
        {"a.bag": bags.ros1, "c.mcap": bags.mcap}[name](path, said(points, 2))
    whole = path.read_bytes()
    for _ in range(60):
        damaged = bytearray(whole[: draw.randrange(len(whole))] if draw.random() < 0.3 else whole)
        for _ in range(draw.randrange(1, 6)):
            if damaged:
                damaged[draw.randrange(min(len(damaged), 700))] = draw.randrange(256)
        path.write_bytes(damaged)
        with suppress(ScanError):
            scans = open_scans(path)
            assert all(scans[i].points.shape[1] == 3 for i in range(min(len(scans), 5)))
