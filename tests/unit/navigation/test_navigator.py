"""Whole drives of the navigator node in a world of boxes: it arrives, hits nothing, waits, recovers or says so."""

import math
from dataclasses import replace

import numpy as np
import pytest
from orograph.messages import Drive, Envelope, Frame, Mission, OccupancyGrid, Pose, RobotStatus, Sensors
from orograph.navigation.navigator import Navigator
from orograph.navigation.return_path import ReturnPath
from orograph.nodes.navigator import NavigatorNode
from orograph.registers import unpack
from orograph.scene.prior import prior_records
from orograph.scene.site import Site
from unicycle.world import FRAME_NS, UnicycleWorld, scenario_of

BLOCKS = [(20, 20, 45, 45), (60, 20, 80, 45), (20, 60, 45, 80), (60, 60, 80, 80)]
TOUR = [(52, 12), (52, 52), (90, 52), (90, 90), (12, 90)]


def is_done(world):
    return "done" in world.kinds()


@pytest.mark.parametrize("seed", [1, 2])
def test_it_drives_its_tour_past_surprises_without_a_touch(seed):
    surprises = [(50, 25, 53, 28), (88, 70, 92, 72), (30, 84, 31, 92)]
    world = UnicycleWorld(scenario_of(TOUR), BLOCKS, surprises=surprises, seed=seed).run(160, is_done)
    assert [f["index"] for _, kind, f in world.notes if kind == "waypoint"] == [0, 1, 2, 3, 4]
    assert world.hits == []
    assert world.statuses[-1].state == "done" or world.run(1.5).statuses[-1].state == "done"
    assert world.node.artifacts()["driven_m"] / (world.index / 10) > 2.0, "average speed"
    errors = np.array([(p.x_m - x, p.y_m - y) for p, (x, y, _) in world.poses])
    assert np.sqrt(np.mean(errors**2)) < 0.03


def test_it_drives_the_same_drive_twice():
    tracks = [np.array(UnicycleWorld(scenario_of(TOUR), BLOCKS).run(20).track) for _ in range(2)]
    np.testing.assert_array_equal(tracks[0], tracks[1])


@pytest.mark.parametrize("phase", [0.0, 0.7, 1.4, 2.1])
def test_a_walker_who_crosses_is_not_hit(phase):
    """He never yields; vehicles, which are faster, do."""
    street = [(0, 16, 100, 20), (0, 4, 100, 8)]

    def mover(t):
        y = -8 + 1.5 * (t + phase)
        return (32, y, 33, y + 1)

    scenario = scenario_of([(70, 12)], start=(6, 12, 0))
    world = UnicycleWorld(scenario, street, mover=mover).run(90, is_done)
    assert world.notes[-1][1] == "done"
    assert world.hits == []


def test_it_stops_for_what_blocks_the_street_and_goes_on_when_it_has_gone():
    street = [(0, 16, 100, 20), (0, 4, 100, 8)]
    world = UnicycleWorld(
        scenario_of([(70, 12)], start=(6, 12, 0)), street, mover=lambda t: (30, 8, 33, 16) if t < 15 else None
    ).run(90, is_done)
    assert world.hits == []
    standing = [x for t, x, y, yaw, v, *_ in world.track if 12.5 < t < 15 and abs(v) < 0.05]
    assert len(standing) > 20 and 20 < standing[0] < 29.5
    assert [kind for _, kind, _ in world.notes][-2:] == ["waypoint", "done"]


def test_a_dead_end_that_the_prior_does_not_know_is_left_again():
    trap = [(40, 5, 42, 20), (20, 18, 42, 20), (20, 5, 42, 7)]
    world = UnicycleWorld(scenario_of([(60, 12)], start=(10, 12.5, 0)), surprises=trap).run(120, is_done)
    assert world.hits == []
    assert world.node.artifacts()["trajectory"][-1, 1] > 50


def test_shut_in_it_gives_up_and_says_so():
    cage = [(8, 8, 9, 17), (16, 8, 17, 17), (8, 8, 17, 9), (8, 16, 17, 17)]
    world = UnicycleWorld(scenario_of([(60, 12)]), surprises=cage).run(90, is_done).run(2)
    assert world.hits == []
    assert world.kinds().count("stuck") == 3
    assert world.statuses[-1].state == "blocked"
    assert world.statuses[-1].given_up.tolist() == [0]


def test_wheels_that_spin_for_a_while_are_recovered_from():
    world = UnicycleWorld(scenario_of([(60, 12)]), jammed=lambda t: 6 < t < 14).run(60, is_done)
    assert world.kinds() == ["stuck", "recovered", "waypoint", "done"]


def test_held_fast_it_gives_up_one_waypoint_after_the_other():
    world = UnicycleWorld(scenario_of([(60, 12), (12, 60)]), jammed=lambda t: t > 6).run(90, is_done)
    assert [f["index"] for _, kind, f in world.notes if kind == "gave-up"] == [0, 1]


def test_a_waypoint_inside_a_building_is_given_up_from_beside_it():
    world = UnicycleWorld(scenario_of([(70, 32), (52, 12)]), BLOCKS).run(90, is_done)
    assert [f["index"] for _, kind, f in world.notes if kind == "gave-up"] == [0]
    assert [f["index"] for _, kind, f in world.notes if kind == "waypoint"] == [1]
    assert world.hits == []


def test_done_in_a_shadow_it_returns_to_where_it_last_had_radio():
    world = UnicycleWorld(scenario_of([(12, 90)]), BLOCKS, radio=lambda x, y: y < 60).run(60)
    assert world.kinds() == ["waypoint", "done", "returning"]
    assert 50 < world.y < 60
    assert world.statuses[-1].state == "done"
    assert abs(world.v) < 0.05


def test_without_local_maps_it_stops_within_two_seconds():
    world = UnicycleWorld(scenario_of([(90, 12)]), maps_until_s=8.0).run(14)
    moving = [t for t, *_, v, _, _ in world.track if abs(v) > 0.05]
    assert 9.0 < max(moving) < 11.5


def test_poor_gps_on_the_way_does_not_stop_it():
    world = UnicycleWorld(scenario_of(TOUR), BLOCKS, gps=lambda x, y: 0 if x > 60 else 1).run(160, is_done)
    assert len(world.notes) == 6
    assert world.hits == []


def test_places_with_radio_are_driven_to_backwards_until_it_is_heard_and_then_the_base_station():
    second = 1_000_000_000
    back = ReturnPath((0.0, 0.0))
    for k in range(20):
        back.heard(k * second, 31.0 + k, 0.0)
    assert back.goal(24 * second, (80.0, 0.0)) is None, "not silent for long enough"
    assert back.goal(25 * second, (80.0, 0.0)) == (50.0, 0.0)
    assert back.goal(40 * second, (50.0, 1.0)) == (45.0, 0.0), "it does not stop there"
    back.abandon()
    assert back.goal(40 * second, (50.0, 1.0)) == (38.0, 0.0)
    assert back.goal(41 * second, (38.0, 1.0)) == (31.0, 0.0)
    assert back.goal(42 * second, (31.0, 1.0)) == (0.0, 0.0)
    assert back.goal(60 * second, (0.0, 1.0)) is None, "nowhere else is better"
    back.heard(61 * second, 45.0, 0.0)
    assert back.goal(62 * second, (45.0, 0.0)) is None


def test_where_it_last_heard_the_radio_may_lie_in_the_shadow_by_now():
    """A shadow that has grown since: it goes on until it hears, not across the town to the base."""
    edge = iter([50.0] * 24)
    world = UnicycleWorld(
        scenario_of([(70, 12)], start=(6, 12, 0), base_station_m=(90, 90)),
        radio=lambda x, y: x < next(edge, 30.0),
    ).run(60)
    assert 20 < world.x < 31 and abs(world.y - 12) < 3
    assert world.node._navigator.state == "done"


@pytest.mark.parametrize("gps", [2, 1])
def test_wheels_that_turn_on_the_spot_are_noticed_and_the_goal_given_up(gps):
    """On its belly: odometry says 1 m/s, the world that nothing moves."""
    node = NavigatorNode(Site(scenario_of([(60, 12)])), "robot_001", 1)
    notes = []
    for k in range(600):
        spins = replace(still(k, gps if k > 50 else 2), odometry_v_mps=1.0 if k > 60 else 0.0)
        heard = [spins, *(maps(k) if k % 4 == 0 else ()), *([mission(1, 0)] if k % 10 == 0 else ())]
        notes += [kind for kind, _ in step(node, k, *heard)[1]]
    assert ("wheels-spin" in notes) == (gps == 2)
    assert gps == 1 or (notes.count("stuck") == 3 and "gave-up" in notes)


# --- the node's manners --------------------------------------------------------------------------------------------


def step(node, k, *messages):
    """One frame; (sent, notes)."""
    sent, notes = [], []
    inbox = [Envelope("sim", node.name, "x", k - 1, i, m) for i, m in enumerate(messages)]
    node.step(Frame(k, k * FRAME_NS, FRAME_NS), inbox, lambda *s: sent.append(s), lambda *n: notes.append(n))
    return sent, notes


def still(k, quality=2, x=12.5):
    return Sensors(k * FRAME_NS, quality, x, 12.5, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)


def maps(k):
    return (
        OccupancyGrid(k * FRAME_NS, 0.0, 0.0, 5.0, True, np.zeros((20, 20), np.uint8)),
        OccupancyGrid(k * FRAME_NS, 0.0, 0.0, 0.5, False, np.zeros((200, 200), np.uint8)),
    )


def drives(sent):
    return [m for _, _, m in sent if isinstance(m, Drive)]


def mission(number, *waypoints, flush=False):
    return Mission(number, np.array(waypoints, "<u2"), flush)


def test_each_sensors_message_is_answered_by_a_pose_and_a_drive_of_its_own_frame():
    node = NavigatorNode(Site(scenario_of([(60, 12)])), "robot_001", 1)
    sent, _ = step(node, 1, still(0))
    pose = next(m for plane, to, m in sent if isinstance(m, Pose))
    assert pose.stamp_ns == 0
    assert (pose.x_m, pose.y_m) == pytest.approx((12.5, 12.5), abs=1e-6)
    assert [(plane, to) for plane, to, _ in sent] == [
        ("sim", "robot-mapping/robot_001"),
        ("sim", "world"),
        ("radio", "orchestrator"),
    ]
    assert step(node, 2)[0] == []


def test_it_does_not_drive_before_the_maps_are_there():
    node = NavigatorNode(Site(scenario_of([(60, 12)])), "robot_001", 1)
    for k in range(1, 6):
        sent, _ = step(node, k, still(k - 1), mission(1, 0))
        assert drives(sent)[0].v_mps == 0
    assert drives(step(node, 6, still(5), *maps(4))[0])[0].v_mps > 0


def test_after_a_restart_it_waits_for_gps_before_it_drives():
    node = NavigatorNode(Site(scenario_of([(60, 12)])), "robot_001", 1)
    for k in range(500, 505):
        sent, _ = step(node, k, still(k - 1, quality=0, x=30.0), mission(1, 0), *maps(k))
        assert not any(isinstance(m, Pose) for _, _, m in sent)
        assert drives(sent)[0].v_mps == 0
    sent, _ = step(node, 505, still(504, x=30.0), mission(1, 0), *maps(504))
    assert drives(sent)[0].v_mps > 0
    assert next(m for _, _, m in sent if isinstance(m, Pose)).x_m == pytest.approx(30.0, abs=0.01)


def test_a_status_is_sent_every_second_and_at_a_waypoint():
    node = NavigatorNode(Site(scenario_of([(12.5, 13)])), "robot_001", 1)
    sent = {k: step(node, k, still(k - 1), *((mission(1, 0), *maps(k)) if k == 15 else ()))[0] for k in range(1, 40)}
    at = [k for k, messages in sent.items() if any(isinstance(m, RobotStatus) for _, _, m in messages)]
    assert at == [1, 10, 15, 20, 30]
    status = next(m for _, _, m in sent[15] if isinstance(m, RobotStatus))
    assert (status.mission, status.visited.tolist(), status.state) == (1, [0], "done")


def test_only_a_newer_mission_counts_and_flush_stops_the_robot():
    node = NavigatorNode(Site(scenario_of([(60, 12), (12, 60)])), "robot_001", 1)
    step(node, 1, still(0), mission(5, 0), *maps(0))
    step(node, 2, still(1), mission(4, 1), *maps(1))
    assert node.telemetry()["waypoints_left"] == 1
    assert drives(step(node, 3, still(2), *maps(2))[0])[0].v_mps > 0
    assert drives(step(node, 4, still(3), mission(5, 0, flush=True))[0])[0].v_mps == 0
    assert node.telemetry()["waypoints_left"] == 0
    step(node, 5, still(4), mission(6, 1, 0, 7))
    assert node.telemetry()["waypoints_left"] == 2, "waypoint 7 does not exist"


def test_at_the_end_of_time_it_stops_by_itself():
    node = NavigatorNode(Site(scenario_of([(60, 12)], duration_max_s=2.0)), "robot_001", 1)
    for k in range(1, 30):
        sent, _ = step(node, k, still(k - 1), mission(1, 0), *maps(k))
        assert (drives(sent)[0].v_mps > 0 or drives(sent)[0].yaw_rate_radps != 0) == (k < 20), k


def test_artifacts_hold_one_row_per_pose():
    world = UnicycleWorld(scenario_of([(30, 12)])).run(5)
    trajectory = world.node.artifacts()["trajectory"]
    assert trajectory.shape == (49, 6)
    np.testing.assert_array_equal(np.diff(trajectory[:, 0]), FRAME_NS)
    assert math.isfinite(trajectory[:, 5].max())
    assert set(world.node.telemetry()) == {
        "position_sigma_m", "driven_m", "global_replans", "local_replans", "recoveries", "waypoints_left", "state",
    }  # fmt: skip


@pytest.mark.parametrize(
    ("prior", "z_m"),
    [
        ({}, 5.25),  # 5 + 0.1 * 2.5: the plane of its cell
        ({"building_height_m": 3.0}, 5.25),
        ({"confidence": 0}, 0.0),  # knows nothing: GPS
        ({"ground_error_m": 2.0}, None),
    ],
)
def test_it_takes_the_ground_from_the_prior_map_and_not_from_the_world(prior, z_m):
    ground = {"height_m": 4.0, "slope_x": 0.1}
    scenario = scenario_of([(60, 12)], terrain=ground, prior=prior)
    if z_m is None:
        prior_map = unpack(prior_records(scenario), scenario.grid.grid)
        z_m = float(prior_map.height[2, 2])
        assert abs(z_m - 5.25) > 0.1
    sent, _ = step(NavigatorNode(Site(scenario), "robot_001", 1), 1, still(0))
    first = next(m for _, _, m in sent if isinstance(m, Pose))
    assert first.z_m == pytest.approx(z_m, abs=2e-3)


def test_under_a_roof_of_a_prior_of_one_surface_it_knows_no_ground():
    house = {"footprint": [[30, 30], [50, 30], [50, 50], [30, 50]], "height_m": 5.0}
    for rules, under_m in (("paper", None), ("surface", 4.0)):
        world = scenario_of([(60, 12)], terrain={"height_m": 4.0}, buildings=[house], rules=rules)
        navigator = Navigator(Site(world), "robot_001")
        assert [navigator.ground_m(x, 42.0) for x in (20.0, 42.0, 130.0)] == [4.0, under_m, None]
