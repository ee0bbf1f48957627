"""Navigation sensors: noise of the stated size, equal for equal seeds, independent otherwise."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import pytest
from orograph.geometry import rotation
from orograph.messages import Sensors
from orograph.scenario import Scenario
from orograph.world.navigation_sensors import Motion, NavigationSensors

MOTION = Motion(np.array([10.0, 20.0, 3.0]), rotation(0.1, -0.2, 3.1), 0.5, 1.0)


def readings(scenario: Scenario, quality: int, count: int = 2000, seed: int = 7) -> list[Sensors]:
    sensors = NavigationSensors(scenario, seed, "robot_001")
    return [sensors.read(MOTION, quality, frame * 100, frame) for frame in range(count)]


@pytest.mark.parametrize(("quality", "sigma_m"), [(1, 1.5), (2, 0.05)])
def test_gps_noise_by_quality(scenario_of: Callable[..., Scenario], quality: int, sigma_m: float) -> None:
    fixes = np.array([(s.gps_x_m, s.gps_y_m, s.gps_z_m) for s in readings(scenario_of(), quality)])
    assert fixes.mean(axis=0) == pytest.approx(MOTION.position_m, abs=6 * sigma_m / math.sqrt(2000) * 1.5)
    assert fixes.std(axis=0) == pytest.approx([sigma_m, sigma_m, 1.5 * sigma_m], rel=0.1)


def test_no_gps_tells_nothing(scenario_of: Callable[..., Scenario]) -> None:
    reading = readings(scenario_of(), 0, count=1)[0]
    assert (reading.gps_quality, reading.gps_x_m, reading.gps_y_m, reading.gps_z_m) == (0, 0.0, 0.0, 0.0)


def test_imu_and_odometry_noise(scenario_of: Callable[..., Scenario]) -> None:
    scenario = scenario_of()
    seen = readings(scenario, 2)
    spec = scenario.navigation_sensors
    assert np.std([s.roll_rad for s in seen]) == pytest.approx(math.radians(spec.attitude_deg), rel=0.1)
    assert np.std([s.pitch_rad for s in seen]) == pytest.approx(math.radians(spec.attitude_deg), rel=0.1)
    assert np.std([(s.yaw_rad - 3.1 + 3) % (2 * math.pi) for s in seen]) == pytest.approx(math.radians(0.4), rel=0.1)
    assert np.std([s.yaw_rate_radps for s in seen]) == pytest.approx(spec.yaw_rate_radps, rel=0.1)
    assert np.std([s.odometry_v_mps for s in seen]) == pytest.approx(spec.odometry_mps, rel=0.1)
    assert all(-math.pi <= s.yaw_rad < math.pi for s in seen)


def test_odometry_scale_is_the_robot_s_own(scenario_of: Callable[..., Scenario]) -> None:
    means = {
        seed: float(np.mean([s.odometry_v_mps for s in readings(scenario_of(), 2, 500, seed)])) for seed in range(40)
    }
    assert 0.005 < np.std(list(means.values())) < 0.02, means  # sigma 0.01, plus 0.001 from averaging noise


def test_same_seed_same_noise_whatever_was_read_before(scenario_of: Callable[..., Scenario]) -> None:
    fresh = NavigationSensors(scenario_of(), 3, "robot_002").read(MOTION, 1, 900, 9)
    used = NavigationSensors(scenario_of(), 3, "robot_002")
    for frame in range(9):
        used.read(MOTION, 0, frame * 100, frame)
    assert vars(used.read(MOTION, 1, 900, 9)) == vars(fresh)
    assert fresh.gps_x_m != NavigationSensors(scenario_of(), 4, "robot_002").read(MOTION, 1, 900, 9).gps_x_m
    assert fresh.gps_x_m != NavigationSensors(scenario_of(), 3, "robot_001").read(MOTION, 1, 900, 9).gps_x_m
