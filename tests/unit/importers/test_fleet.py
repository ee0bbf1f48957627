"""Towns for fleets of any size: what loads can be driven, and is the same for the same seed."""

import math
from pathlib import Path

import numpy as np
import pytest
import shapely
from orograph.cli.main import main
from orograph.mission.distances import UNREACHABLE_M, DrivingDistances
from orograph.scenario import Scenario
from orograph.scene.buildings import is_rectangle
from orograph.scene.prior import COVERED, building_cover, given_layers
from orograph.storage.scenario_file import load_scenario

FILES = ("README.md", "buildings.json", "scenario.yaml")


def _made(out: Path, robots: int, seed: int) -> Path:
    assert main(["fleet", str(robots), "--seed", str(seed), "--out", str(out)]) == 0
    return out


@pytest.fixture(scope="module", params=[(1, 1), (3, 1), (3, 2), (10, 1), (10, 77), (100, 1)], ids=str)
def scenario(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Scenario:
    robots, seed = request.param
    made = load_scenario(_made(tmp_path_factory.mktemp("fleet") / "town", robots, seed))
    assert (made.robots, len(made.starts), made.seed) == (robots, robots, seed)
    return made


@pytest.fixture(scope="module")
def walls(scenario: Scenario) -> list[shapely.Polygon]:
    return [shapely.Polygon(building.footprint) for building in scenario.buildings]


def _nearest_m(walls: list[shapely.Polygon], shapes: list[shapely.Geometry]) -> float:
    return float(shapely.STRtree(walls).query_nearest(shapes, return_distance=True)[1].min())


def test_every_waypoint_is_reached_from_a_start_over_the_true_map(
    scenario: Scenario, walls: list[shapely.Polygon]
) -> None:
    grid = scenario.grid.grid
    blocked = building_cover(walls, grid) >= COVERED
    starts = [(s.x_m, s.y_m) for s in scenario.starts]
    assert not any(blocked[grid.row_col(*place)] for place in (*starts, *scenario.patrol))
    reach_m = DrivingDistances(blocked.astype(float), grid).between(starts[:1], [*starts, *scenario.patrol])
    assert reach_m.max() < UNREACHABLE_M


def test_robots_and_vehicles_keep_off_walls_and_each_other(scenario: Scenario, walls: list[shapely.Polygon]) -> None:
    starts = [shapely.Point(s.x_m, s.y_m) for s in scenario.starts]
    assert _nearest_m(walls, [*starts, *map(shapely.Point, scenario.patrol)]) >= 7
    for vehicle in scenario.vehicles:
        loop = shapely.LinearRing(vehicle.loop)
        assert _nearest_m(walls, [loop]) >= 0.5 * vehicle.size_m[1] + 0.3
        assert min(map(loop.distance, starts)) >= 0.5 * vehicle.size_m[1] + 1
    spread_m = 0.6 * math.sqrt(scenario.grid.rows * scenario.grid.cols / len(starts)) * scenario.grid.cell_m
    pairs = shapely.STRtree(starts).query(starts, predicate="dwithin", distance=spread_m)
    assert len(pairs[0]) == len(starts)  # each is near itself alone


def test_robots_head_along_their_street(scenario: Scenario, walls: list[shapely.Polygon]) -> None:
    """12 m ahead and behind, walls are as far as half a street's width."""
    for s in scenario.starts:
        heading, at = math.radians(s.heading_deg), np.array([s.x_m, s.y_m])
        ahead = np.array([math.cos(heading), math.sin(heading)]) * 12
        street = shapely.LineString([at - ahead, at + ahead])
        assert _nearest_m(walls, [street]) >= 6.5


def test_orders_reach_every_start(scenario: Scenario) -> None:
    gps, radio = given_layers(scenario)
    assert (radio == 0).any() and (gps < 2).any()
    grid = scenario.grid.grid
    for place in (scenario.base_station_m, *((s.x_m, s.y_m) for s in scenario.starts)):
        assert radio[grid.row_col(*place)] == 1


def test_each_robot_has_a_share_of_streets_and_houses_are_of_several_kinds(scenario: Scenario) -> None:
    assert 7 <= len(scenario.patrol) / scenario.robots <= 31
    assert {building.roof for building in scenario.buildings} > {"flat"}
    ridged = [np.array(building.footprint) for building in scenario.buildings if building.roof != "flat"]
    assert all(map(is_rectangle, ridged))
    places = np.array(scenario.patrol)
    apart_m = np.linalg.norm(places[:, None] - places, axis=2) + 1e6 * np.eye(len(places))
    assert apart_m.min() >= 15 and apart_m.min(axis=1).max() <= 45


def test_a_seed_makes_the_same_bytes_and_another_seed_another_town(tmp_path: Path) -> None:
    one, again, other = (_made(tmp_path / str(i) / "town", 10, seed) for i, seed in enumerate((5, 5, 6)))
    assert [(one / f).read_bytes() for f in FILES] == [(again / f).read_bytes() for f in FILES]
    assert (one / "buildings.json").read_bytes() != (other / "buildings.json").read_bytes()


@pytest.mark.parametrize(
    ("words", "said"),
    [(["0"], "1 to 100 robots"), (["101"], "1 to 100 robots"), (["3", "--seed", "-1"], "--seed -1: expected 0 to")],
)
def test_what_cannot_be_made_is_refused_in_a_line(
    words: list[str], said: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["fleet", *words, "--out", str(tmp_path / "x")]) == 2
    err = capsys.readouterr().err
    assert said in err and err.count("\n") == 1
    assert not (tmp_path / "x").exists()
