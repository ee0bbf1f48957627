"""The cluster in containers: healthy at once, the local run's map, fleets that grow and shrink, workers that die."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from containers.conftest import Cluster, call, until
from orograph import keys
from orograph.launch.lifecycle import resolve, run
from orograph.storage.results import Summary
from orograph.storage.run_folder import node_file
from orograph.storage.scenario_file import load_scenario

pytestmark = [pytest.mark.containers, pytest.mark.timeout(600)]
PROCESS = (
    "for p in /proc/[0-9]*; do tr '\\0' ' ' < $p/cmdline | grep -q '^python -m services' && kill -9 ${p#/proc/}; done"
)


def test_three_robots_are_healthy_in_half_a_minute_and_make_the_local_map(
    start: Callable[..., Cluster], tmp_path: Path
) -> None:
    cluster = start(ROBOTS="3", SCENARIO="tiny")
    cluster.up(within_s=30)
    for service in keys.ROBOT_SERVICES:
        assert set(until(lambda s=service: len(h := cluster.holders(s)) == 3 and h, service)) == {
            "robot_001", "robot_002", "robot_003"
        }  # fmt: skip
    cluster.await_end()
    for service in keys.SERVICES:
        codes = [until(lambda c=c: (cluster.exit_code(c),), service) for c in cluster.containers(service)]
        assert set(codes) == {(0,)}, service
    found = Summary.read(cluster.fetch(tmp_path / "fetched"))
    local = Summary.read(run(resolve(load_scenario("tiny"), 3, None, None), tmp_path / "local", in_process=True))
    assert found.complete and found.deterministic and found.copies_hash_equal and found.cells_lost == 0
    assert found.glrm_hash == local.glrm_hash


def test_a_fleet_grows_and_shrinks_in_the_middle_of_a_mission(start: Callable[..., Cluster], tmp_path: Path) -> None:
    cluster = start(ROBOTS="3", START_WITH="1", TIME_SCALE="1", SCENARIO="tiny")

    def scale(n: int) -> None:
        wanted = [part for service in keys.ROBOT_SERVICES for part in ("--scale", f"{service}={n}")]
        cluster.up("--no-recreate", *wanted)

    scale(1)
    assert set(cluster.holders(keys.NAVIGATOR)) == {"robot_001"}
    scale(3)
    for service in keys.ROBOT_SERVICES:
        until(lambda s=service: len(cluster.holders(s)) == 3, f"three robots have a {service}")
    scale(2)
    cluster.await_end()
    out = cluster.fetch(tmp_path)
    summary = Summary.read(out)
    assert summary.complete and summary.copies_hash_equal and summary.cells_lost == 0
    with np.load(out / node_file(keys.WORLD)) as world:
        drove = {r for r in ("robot_001", "robot_002", "robot_003") if np.ptp(world[f"{r}_truth"][:, 1:3]) > 1}
    assert {"robot_001"} < drove
    with np.load(out / node_file(keys.MANAGER)) as manager:
        assert set(np.unique(manager["registers"]["robot"])) - {0} == {1, 2, 3}  # the leaver's evidence stays


def test_a_killed_workers_robot_goes_on_by_a_spare(start: Callable[..., Cluster], tmp_path: Path) -> None:
    cluster = start(ROBOTS="2", SCENARIO="tiny", TIME_SCALE="1")
    cluster.up("--scale", "robot-mapping=3")
    before = until(lambda: len(h := cluster.holders(keys.MAPPING)) == 2 and h, "both robots are held")
    killed = before["robot_001"]
    cluster.inside(killed, PROCESS, check=False)
    after = until(lambda: (h := cluster.holders(keys.MAPPING)).get("robot_001") not in (None, killed) and h, "a spare")
    assert after["robot_002"] == before["robot_002"]
    restarts = lambda: call("docker", "inspect", "--format", "{{.RestartCount}}", killed).stdout.strip()  # noqa: E731
    until(lambda: restarts() == "1", "the killed container is started again, as a spare")
    cluster.await_end()
    summary = Summary.read(cluster.fetch(tmp_path))
    assert summary.complete and summary.copies_hash_equal and summary.cells_lost == 0


def test_a_worker_told_to_stop_has_flushed_within_two_seconds(start: Callable[..., Cluster]) -> None:
    cluster = start(ROBOTS="1", SCENARIO="tiny", TIME_SCALE="1")
    cluster.up()
    for service in (
        keys.MAPPING,
        keys.NAVIGATOR,
        keys.LASER,
        keys.MANAGER,
        keys.ORCHESTRATOR,
        keys.WORLD,
        "router-sim",
    ):
        (container,) = cluster.containers(service)
        call("docker", "stop", "--time", "2", container)
        assert cluster.exit_code(container) == 0, f"{service} was killed after 2 s: {cluster.logs(container)}"


def test_ten_containers_hold_ten_robots(start: Callable[..., Cluster]) -> None:
    cluster = start(ROBOTS="10", SCENARIO="tiny")
    cluster.up("orchestrator", "laser", within_s=120)
    held = until(lambda: len(h := cluster.holders(keys.LASER)) == 10 and h, "all ten hold one")
    assert sorted(held) == [keys.robot_id(i + 1) for i in range(10)]
    assert len(set(held.values())) == 10
