"""Every scenario in the tree can be driven: places reachable, starts and streets free, vehicles clear of walls."""

import pytest
import shapely
from orograph.mission.distances import UNREACHABLE_M, DrivingDistances
from orograph.registers import unpack
from orograph.scenario import Scenario
from orograph.scene.prior import given_layers, prior_records
from orograph.storage.scenario_file import load_scenario

NAMES = ("helsinki", "paper", "tiny")


@pytest.fixture(scope="module", params=NAMES)
def scenario(request: pytest.FixtureRequest) -> Scenario:
    return load_scenario(f"scenarios/{request.param}")


@pytest.fixture(scope="module")
def walls(scenario: Scenario) -> shapely.Geometry:
    return shapely.union_all([shapely.Polygon(b.footprint) for b in scenario.buildings])


def test_the_name_is_the_folders(scenario: Scenario) -> None:
    assert scenario.name in NAMES


def test_all_places_are_reachable_from_each_other(scenario: Scenario) -> None:
    occupation = unpack(prior_records(scenario), scenario.grid.grid).occupation
    places = [*scenario.patrol, *((s.x_m, s.y_m) for s in scenario.starts)]
    distance_m = DrivingDistances(occupation, scenario.grid.grid).between(places, places)
    assert distance_m.max() < UNREACHABLE_M


def test_starts_and_waypoints_keep_off_the_walls(scenario: Scenario, walls: shapely.Geometry) -> None:
    assert min(walls.distance(shapely.Point(s.x_m, s.y_m)) for s in scenario.starts) >= 1.5
    assert min(walls.distance(shapely.Point(p)) for p in scenario.patrol) >= 4.9


def test_vehicles_keep_off_the_walls(scenario: Scenario, walls: shapely.Geometry) -> None:
    assert scenario.vehicles
    for vehicle in scenario.vehicles:
        assert walls.distance(shapely.LinearRing(vehicle.loop)) >= 0.5 * vehicle.size_m[1] + 0.3


def test_each_shows_a_radio_shadow_and_poor_gps_and_a_base_in_reach(scenario: Scenario) -> None:
    gps, radio = given_layers(scenario)
    assert (radio == 0).any() and (gps < 2).any()
    row, col = scenario.grid.grid.row_col(*scenario.base_station_m)
    assert radio[row, col] == 1


def test_prior_confidence_alone_never_counts_as_mapped(scenario: Scenario) -> None:
    assert prior_records(scenario)["confidence"].max() < 64
