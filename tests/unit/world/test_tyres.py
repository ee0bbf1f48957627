"""Tyres: they stick, slide and spin as Coulomb's law says; whole robots turn as quasi-static equilibrium says."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import numpy.typing as npt
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from orograph.geometry import roll_pitch_yaw
from orograph.scenario import Building, RobotSpec, Scenario, Start, TerrainSpec
from orograph.world import World
from orograph.world.motors import effective_track_m
from orograph.world.robot_body import AXLE_INERTIA_KGM2, WHEELS
from orograph.world.tyre_kernels import axes_of, wheel_loads_n
from orograph.world.tyres import TYRE_FRICTION, Tyres
from scipy.optimize import fsolve
from scipy.spatial.transform import Rotation

SPEC = RobotSpec()
STEP_S = 0.005
WEIGHT_N = 9.81 * SPEC.mass_kg
CENTRE_OF_MASS_M = 0.1848
"""Height, by hand: 57.2 kg a third up the box from 0.0825 m to 0.42 m, 7.8 kg at the hubs."""
ROBOT, FRAME_NS = "robot_001", 100_000_000
PLACES_M = np.array([(0.5 * x * SPEC.wheelbase_m, 0.5 * y * SPEC.track_m) for x, y in WHEELS])
F64 = npt.NDArray[np.float64]
Make = Callable[..., Scenario]


def step(tyres: Tyres, velocity: list[float], lift_n: float, torques_nm: F64, turn_rad: F64 | None = None) -> F64:
    """One step of one robot that moves so in its own frame; the wrench (6,) in its own frame."""
    R = Rotation.from_rotvec(np.zeros(3) if turn_rad is None else turn_rad).as_matrix()
    pose, moving = np.zeros((1, 6)), np.array([velocity]).reshape(2, 3) @ R.T
    pose[0, :3] = 0.0 if turn_rad is None else turn_rad
    carried = np.array([[*np.zeros(3), *(R @ [0.0, 0.0, lift_n])]])
    wrench = tyres.step(pose, moving.reshape(1, 6), carried, torques_nm)
    return np.concatenate([wrench[0, :3] @ R, wrench[0, 3:] @ R])


@settings(deadline=None)  # The first example may compile the kernels.
@given(turn_rad=st.tuples(*3 * [st.floats(-3, 3)]))
def test_axes_are_the_columns_of_the_rotation(turn_rad: tuple[float, float, float]) -> None:
    found = np.stack(axes_of(np.array(turn_rad)), axis=1)
    np.testing.assert_allclose(found, Rotation.from_rotvec(turn_rad).as_matrix(), atol=1e-12)


@settings(deadline=None)  # The first example may compile the kernels.
@given(lift_n=st.floats(1, 1000), tilt=st.tuples(st.floats(-1, 1), st.floats(-1, 1)))
def test_loads_are_the_least_that_carry(lift_n: float, tilt: tuple[float, float]) -> None:
    """Oracle: the pseudo-inverse of force and moments over the four places, wherever it keeps all wheels down."""
    roll_nm, pitch_nm = np.array(tilt) * lift_n * 0.2
    constants = np.array([0.5 * SPEC.wheelbase_m, 0.5 * SPEC.track_m])
    loads = wheel_loads_n(lift_n, roll_nm, pitch_nm, constants)
    carrying = np.stack([np.ones(4), PLACES_M[:, 1], -PLACES_M[:, 0]])
    expected = np.linalg.pinv(carrying) @ [lift_n, roll_nm, pitch_nm]
    assert loads.min() >= 0 and loads.sum() == pytest.approx(lift_n)
    if expected.min() >= 0:
        np.testing.assert_allclose(loads, expected, atol=1e-9 * lift_n)


def test_a_wheel_in_the_air_spins_freely() -> None:
    tyres = Tyres(SPEC, 1, STEP_S)
    wrench = step(tyres, [0, 0, 0.3, 1, 0.5, 0], 0.0, np.full((1, 4), 2.0))
    assert tyres.speeds_radps == pytest.approx(np.full((1, 4), 2.0 * STEP_S / AXLE_INERTIA_KGM2))
    assert wrench == pytest.approx([0, -8, 0, 0, 0, 0], abs=1e-12)  # the motors' counter-torque alone


@settings(deadline=None)  # The first example may compile the kernels.
@given(heading=st.floats(-3, 3), turn_rad=st.tuples(*3 * [st.floats(-2, 2)]))
def test_a_slid_robot_is_held_by_friction_times_load(heading: float, turn_rad: tuple[float, float, float]) -> None:
    """Sideways or ahead with locked wheels, after the tyres have bent: opposed to the slip, in the body's own frame."""
    tyres, slip = Tyres(SPEC, 1, STEP_S), np.array([math.cos(heading), math.sin(heading)])
    for _ in range(200):
        braked_nm = (-tyres.speeds_radps) * AXLE_INERTIA_KGM2 / STEP_S - _reaction_nm(slip)
        wrench = step(tyres, [0, 0, 0, *slip, 0], WEIGHT_N, braked_nm, np.array(turn_rad))
    assert wrench[3:5] == pytest.approx(-TYRE_FRICTION * WEIGHT_N * slip, rel=2e-2, abs=2.0)
    assert wrench[5] == pytest.approx(0, abs=1e-9) and wrench[2] == pytest.approx(0, abs=1e-9)


def _reaction_nm(slip: F64) -> float:
    """Torque of a sliding foot on its wheel, which a brake must hold."""
    return float(TYRE_FRICTION * WEIGHT_N / 4 * slip[0] * SPEC.wheel_radius_m)


def test_a_pull_below_friction_is_held_in_place() -> None:
    """A body of the robot's mass pulled sideways with half of what would move it comes to rest within millimetres."""
    tyres, place_m, speed_mps = Tyres(SPEC, 1, STEP_S), 0.0, 0.0
    pull_n = 0.5 * TYRE_FRICTION * WEIGHT_N
    for _ in range(400):
        force_n = step(tyres, [0, 0, 0, 0, speed_mps, 0], WEIGHT_N, np.zeros((1, 4)))[4]
        speed_mps += (pull_n + force_n) / SPEC.mass_kg * STEP_S
        place_m += speed_mps * STEP_S
    assert abs(speed_mps) < 1e-6 and 0 < place_m < 0.005
    assert force_n == pytest.approx(-pull_n)


def equilibrium(v_mps: float, yaw_rate_radps: float) -> tuple[float, float]:
    """(speed, yaw rate) of steady driving at these odometry readings: forces and moments of four Coulomb contacts."""
    half_track = 0.5 * effective_track_m(SPEC)

    def unbalanced(motion: F64) -> F64:
        vx, vy, w = motion
        inward_n, total = SPEC.mass_kg * vx * w, np.zeros(3)
        for (x, y), (_, side) in zip(PLACES_M, WHEELS, strict=True):
            load_n = WEIGHT_N / 4 - side * inward_n * CENTRE_OF_MASS_M / (2 * SPEC.track_m)
            slip = np.array([vx - w * y - (v_mps - side * half_track * yaw_rate_radps), vy + w * x])
            force_n = -TYRE_FRICTION * load_n * slip / (np.linalg.norm(slip) + 1e-12)
            total += [force_n[0], force_n[1] - inward_n / 4, x * force_n[1] - y * force_n[0]]
        return total / WEIGHT_N

    sideways = -0.05 * v_mps * yaw_rate_radps
    vx, vy, w = fsolve(unbalanced, [v_mps, sideways, yaw_rate_radps])
    assert np.abs(unbalanced(np.array([vx, vy, w]))).max() < 1e-6
    return math.hypot(vx, vy), w


@pytest.mark.parametrize("drive", [(0.0, 0.2), (0.0, 1.5), (1.0, 0.5), (1.0, -1.0)])
@pytest.mark.parametrize("heading_deg", [0.0, 40.0])
def test_robot_turns_as_equilibrium_says(scenario_of: Make, drive: tuple[float, float], heading_deg: float) -> None:
    """1 % for what the oracle leaves out: the ground's facets and the millimetres that the tyres bend."""
    world = World(scenario_of(starts=(Start(x_m=50, y_m=50, heading_deg=heading_deg),)), (ROBOT,))
    turned_rad, way_m = [], []
    for _ in range(30):
        yaw, place_m = roll_pitch_yaw(world.rotation(ROBOT))[2], world.position_m(ROBOT)
        world.advance({ROBOT: drive}, FRAME_NS)
        turned_rad.append(math.remainder(roll_pitch_yaw(world.rotation(ROBOT))[2] - yaw, 2 * math.pi))
        way_m.append(np.linalg.norm(world.position_m(ROBOT) - place_m))
    speed_mps, yaw_rate_radps = equilibrium(*drive)
    assert sum(turned_rad[-10:]) == pytest.approx(yaw_rate_radps, rel=0.01)
    assert sum(way_m[-10:]) == pytest.approx(speed_mps, rel=0.01, abs=0.005)


@pytest.mark.parametrize("heading_deg", [0.0, 60.0, 90.0, 180.0])
def test_stands_still_on_the_steepest_slope(scenario_of: Make, heading_deg: float) -> None:
    start = Start(x_m=50, y_m=50, heading_deg=heading_deg)
    world = World(scenario_of(terrain=TerrainSpec(slope_x=0.3), starts=(start,)), (ROBOT,))
    for _ in range(10):
        world.advance({}, FRAME_NS)
    held_m = world.position_m(ROBOT)
    for _ in range(50):
        world.advance({}, FRAME_NS)
    assert np.linalg.norm(world.position_m(ROBOT) - held_m) < 0.0025  # 0.5 mm/s


def test_does_not_climb_a_wall(scenario_of: Make) -> None:
    wall = Building(footprint=((54, 40), (60, 40), (60, 60), (54, 60)), height_m=5)
    world = World(scenario_of(buildings=(wall,), starts=(Start(x_m=50, y_m=50, heading_deg=20),)), (ROBOT,))
    for _ in range(80):
        world.advance({ROBOT: (1.0, 0.0)}, FRAME_NS)
    assert world.position_m(ROBOT)[2] == pytest.approx(0, abs=0.02)
    assert world.rotation(ROBOT)[2, 2] > math.cos(0.05)


def test_halted_wheels_stand_where_they_turned_to() -> None:
    tyres = Tyres(SPEC, 2, STEP_S)
    rolling = np.zeros((2, 6)), np.zeros((2, 6)), np.zeros((2, 6)), np.full((2, 4), 1.0)
    tyres.step(*rolling)
    angles = tyres.angles_rad.copy()
    tyres.halt(1)
    assert (tyres.speeds_radps[0] > 0).all() and (tyres.speeds_radps[1] == 0).all()
    assert (tyres.angles_rad == angles).all() and (angles > 0).all()
