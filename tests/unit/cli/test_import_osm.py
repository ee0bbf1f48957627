"""A small town is written as .osm.pbf, imported, loaded and checked; bad input is one line."""

from pathlib import Path

import osmium
import pytest
import shapely
from orograph.cli.import_osm import parse_bbox
from orograph.cli.main import glued, main
from orograph.storage.scenario_file import load_scenario

BBOX = (24.0, 60.0, 24.004, 60.002)
EAST_M, NORTH_M = 55_800.0, 111_412.0
"""A degree at 60 north."""


def _place(x_m: float, y_m: float) -> tuple[float, float]:
    return BBOX[0] + x_m / EAST_M, BBOX[1] + y_m / NORTH_M


class Town:
    """Writes closed and open ways given in metres."""

    def __init__(self, path: Path) -> None:
        self._nodes = self._ways = 0
        self._kept: list[tuple[list[int], dict[str, str]]] = []
        self._writer = osmium.SimpleWriter(str(path))

    def way(self, points_m: list[tuple[float, float]], tags: dict[str, str], closed: bool = False) -> None:
        ids = []
        for x_m, y_m in points_m:
            self._nodes += 1
            self._writer.add_node(osmium.osm.mutable.Node(id=self._nodes, location=_place(x_m, y_m)))
            ids.append(self._nodes)
        self._kept.append(([*ids, ids[0]] if closed else ids, tags))

    def close(self) -> None:
        for number, (ids, tags) in enumerate(self._kept, start=1):
            self._writer.add_way(osmium.osm.mutable.Way(id=number, nodes=ids, tags=tags))
        self._writer.close()


def _block(x: float, y: float, side: float) -> list[tuple[float, float]]:
    return [(x, y), (x + side, y), (x + side, y + side), (x, y + side)]


@pytest.fixture(scope="module")
def extract(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("osm") / "town.osm.pbf"
    town = Town(path)
    tags = [{"building": "yes", "height": "12 m"}, {"building": "yes", "building:levels": "3"}, {"building": "garage"}]
    for i in range(3):
        for j in range(3):
            town.way(_block(25 + 65 * i, 25 + 65 * j, 45), tags[j], closed=True)
    town.way([(0, 0), (2, 0), (2, 2), (0, 2)], {"building": "yes"}, closed=True)
    for k in range(4):
        town.way([(15 + 65 * k, 2), (15 + 65 * k, 220)], {"highway": "residential"})
        town.way([(2, 15 + 65 * k), (220, 15 + 65 * k)], {"highway": "residential"})
    town.way([(30, 47), (60, 47)], {"highway": "residential", "tunnel": "yes"})
    town.close()
    return path


def _import(extract: Path, out: Path, *more: str) -> int:
    return main(["import-osm", str(extract), "--bbox", ",".join(map(str, BBOX)), "--out", str(out), *more])


def test_a_town_becomes_a_scenario_that_can_be_driven(
    extract: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert _import(extract, tmp_path / "town", "--robots", "2", "--waypoints", "7") == 0
    assert "OpenStreetMap contributors" in capsys.readouterr().out
    scenario = load_scenario(tmp_path / "town")
    assert (scenario.robots, len(scenario.starts), len(scenario.patrol)) == (2, 2, 7)
    assert sorted(b.height_m for b in scenario.buildings) == [3.0] * 3 + [10.6] * 3 + [12.0] * 3
    walls = shapely.union_all([shapely.Polygon(b.footprint) for b in scenario.buildings])
    assert walls.area == pytest.approx(9 * 45 * 45, rel=1e-3)
    for place in (*scenario.patrol, *((s.x_m, s.y_m) for s in scenario.starts)):
        assert walls.distance(shapely.Point(place)) >= 4.9
    assert "OpenStreetMap" in scenario.attribution


@pytest.mark.parametrize(
    "bbox",
    ["1,2,3", "a,b,c,d", "24.0,60.0,23.9,60.1", "24.0,60.0,24.0001,60.0001", "24,60,25,61", "nan,60,24.1,60.1"],
)
def test_a_box_that_cannot_be_is_refused(bbox: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["import-osm", "x.osm.pbf", f"--bbox={bbox}", "--out", str(tmp_path / "x")]) == 2
    assert capsys.readouterr().err.count("\n") == 1


def test_what_cannot_be_imported_says_why(extract: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert _import(tmp_path / "none.osm.pbf", tmp_path / "x") == 2
    assert "no such file" in capsys.readouterr().err
    (tmp_path / "junk.osm.pbf").write_bytes(b"not a map at all")
    assert _import(tmp_path / "junk.osm.pbf", tmp_path / "x") == 2
    assert "not an OpenStreetMap extract" in capsys.readouterr().err
    assert main(["import-osm", str(extract), "--bbox", "10,50,10.01,50.01", "--out", str(tmp_path / "x")]) == 2
    assert "0 buildings" in capsys.readouterr().err
    (tmp_path / "full").mkdir()
    (tmp_path / "full" / "mine").write_text("")
    assert _import(extract, tmp_path / "full") == 2
    assert "not an empty folder" in capsys.readouterr().err
    assert not (tmp_path / "x").exists()


def test_a_box_by_hand() -> None:
    assert parse_bbox("24.0,60.0,24.004,60.002") == BBOX


def test_a_box_west_of_greenwich_needs_no_equals_sign() -> None:
    assert glued(["import-osm", "a", "--bbox", "-73.99,40.7,-73.98,40.8", "--out", "x"]) == [
        "import-osm", "a", "--bbox=-73.99,40.7,-73.98,40.8", "--out", "x",
    ]  # fmt: skip
    assert glued(["run", "--quiet", "-h"]) == ["run", "--quiet", "-h"]
