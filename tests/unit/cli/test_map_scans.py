"""`orograph map`, as a person uses it: folders in, a map and a page out, and words for what went wrong."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from made_up import recordings
from made_up.recordings import turned
from orograph.cli.main import main
from orograph.storage.recorded_map import MapInfo, read_map

UTM_M = np.array([385_000.25, 6_672_000.75])


@pytest.fixture
def drive(tmp_path: Path) -> Path:
    """Five scans along 8 m somewhere in Finland, two returns lost in each and the robot's own mast in sight."""
    (tmp_path / "scans").mkdir()
    poses = [turned(UTM_M[0] + 2 * i, UTM_M[1], 0.2, 30.0) for i in range(5)]
    for i in range(5):
        odd = np.array([[0, 0, 0], [np.nan, 0, 0], [0.3, 0, 1.2]])
        points = np.concatenate([recordings.scene(seed=i), odd])
        recordings.pcd_binary(tmp_path / "scans" / f"170000000{i}.000000.pcd", points)
    recordings.tum(tmp_path / "tum.txt", [f"170000000{i}.000000" for i in range(5)], poses)
    return tmp_path


def test_a_folder_of_scans_becomes_a_map_with_a_place(drive: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = drive / "out"
    options = ["--poses", str(drive / "tum.txt"), "--sensor-pose", "0.1,0,1.5", "--self-box=-1,-1,0.1,1,1,3"]
    assert main(["map", str(drive / "scans"), "--out", str(out), "--crs", "EPSG:32635", "--quiet", *options]) == 0
    printed = capsys.readouterr().out
    assert "5 scans, 25,015 points" in printed and "dropped 10 points (0.0%): on the robot itself" in printed
    assert "dropped 5 points (0.0%): not finite" in printed
    assert sorted(path.name for path in out.iterdir()) == ["map.json", "map.npz", "report.html"]
    info, cells = MapInfo.read(out), read_map(out / "map.npz")
    assert (info.scans, info.points, info.crs, info.dropped) == (
        5, 25_015, "EPSG:32635", {"self_box": 10, "not_finite": 5}
    )  # fmt: skip
    found = cells.grid.row_col(*(UTM_M + np.array([3.0, 4.0])))
    assert found is not None and cells.height[found] == pytest.approx(30.0, abs=1e-3)
    stands = cells.by_name["confidence_top"] > 0
    assert (cells.known | stands).sum() == info.cells > cells.known.sum() > 3000
    assert (out / "report.html").read_text().count('<img src="data:') == 2


@pytest.mark.parametrize(("options", "words"), [
    (["--poses", "nowhere.txt"], "--poses nowhere.txt: cannot be read"),
    ([], "5 scans and no poses: give --poses"),
    (["--frame", "map", "--cell", "0.001"], "--cell 0.001: expected 0.01 to 100 m"),
    (["--frame", "map", "--range-min", "90"], "--range-min 90 --range-max 80"),
    (["--frame", "map", "--crs", "EPSG:99999999"], "--crs EPSG:99999999: unknown"),
    (["--frame", "map", "--crs", "EPSG:4326"], "not a projected CRS in metres"),
    (["--frame", "map", "--self-box", "1,2"], "--self-box 1,2: expected x0,y0,z0,x1,y1,z1"),
    (["--frame", "map", "--self-box", "1,0,0,0,1,1"], "each first less than its second"),
    (["--frame", "map", "--sensor-pose", "1,2,high"], "--sensor-pose 1,2,high: expected x,y,z"),
    (["--odometry", "kiss-icp", "--poses", "x"], "--odometry and --poses: one of them"),
    (["--format", "las"], "holds 5 such files; give several LAS files by name"),
])  # fmt: skip
def test_what_is_wrong_is_said_in_one_line_and_nothing_is_left(
    drive: Path, capsys: pytest.CaptureFixture[str], options: list[str], words: str
) -> None:
    assert main(["map", str(drive / "scans"), "--out", str(drive / "out"), *options]) == 2
    printed = capsys.readouterr().err
    assert words in printed and printed.count("\n") == 1
    assert not (drive / "out").exists()


def test_odometry_stands_in_for_poses(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    random = np.random.default_rng(2)
    (tmp_path / "scans").mkdir()
    boxes = [random.uniform(0, 3, (150, 3)) + np.array([x, y, -1.5]) for x, y in random.uniform(-25, 25, (30, 2))]
    world = np.concatenate([recordings.scene(), *boxes])
    for i in range(4):
        recordings.kitti(tmp_path / "scans" / f"00000{i}.bin", world - np.array([0.5 * i, 0, 0]))
    assert main(["map", str(tmp_path / "scans"), "--odometry", "kiss-icp", "--out", str(tmp_path / "out")]) == 0
    page = (tmp_path / "out" / "report.html").read_text()
    assert '<div class="n">2<small>m</small></div><div class="k">way of the sensor' in page


def test_points_of_surveyors_are_mapped_where_they_lie(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    random = np.random.default_rng(5)
    plan_m = random.integers(0, 400_000, (60_000, 2)) / 1000 + 0.0005  # never on the edge of a cell
    points = np.column_stack([plan_m + UTM_M, 12.0 + 0.05 * plan_m[:, 0]])
    recordings.las(tmp_path / "tile.laz", points)
    assert main(["map", str(tmp_path / "tile.laz"), "--out", str(tmp_path / "out"), "--cell", "2", "--quiet"]) == 0
    info, cells = MapInfo.read(tmp_path / "out"), read_map(tmp_path / "out" / "map.npz")
    assert "32635" in info.crs and info.frame == "map" and info.dropped == {}
    rows, cols = cells.grid.rows_cols(points[:, :2])
    count, total = np.zeros(cells.grid.shape), np.zeros(cells.grid.shape)
    np.add.at(count, (rows, cols), 1)
    np.add.at(total, (rows, cols), points[:, 2])
    with np.errstate(invalid="ignore"):
        mean = total / count
    assert np.array_equal(count > 0, cells.known)
    assert np.nanmax(np.abs(mean - cells.height)) < 2e-4


def test_a_jump_of_the_poses_ends_in_words(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for i in range(2):
        T = turned(9000.0 * i, 9000.0 * i, 0)
        np.savez(tmp_path / f"{i}.npz", points=recordings.scene(), T_map_sensor=T, stamp_ns=i)
    assert main(["map", str(tmp_path), "--out", str(tmp_path / "out"), "--quiet"]) == 2
    assert "the map would span 9.1 x 9.1 km: more than 36 million cells of 0.5 m; give --cell 1.6" in (
        capsys.readouterr().err
    )
    assert not (tmp_path / "out").exists()
