"""The profile `watch` on a real cluster: Prometheus finds every replica by DNS, also one that comes later."""

from __future__ import annotations

from collections.abc import Callable

import pytest
from containers.conftest import ROOT, Cluster, call, until
from containers.prometheus_tools import Prometheus, questions
from orograph import keys
from ports import free_port

pytestmark = pytest.mark.containers
ROBOTS = 2
WITHIN_S = 60.0


@pytest.fixture(scope="module")
def cluster(start: Callable[..., Cluster]) -> Cluster:
    call(str(ROOT / "ops/offline-images"), "prometheus")
    made = start(ROBOTS=str(ROBOTS), SCENARIO="tiny", TIME_SCALE="0.5", PROMETHEUS_PORT=str(free_port()))
    made.up(within_s=180)
    # By name: Grafana's image may be out of reach.
    made.up("prometheus")
    return made


@pytest.fixture(scope="module")
def prometheus(cluster: Cluster) -> Prometheus:
    address = cluster.compose("port", "prometheus", "9090").stdout.strip()
    assert address.startswith("127.0.0.1:")
    return Prometheus(f"http://{address}")


def up(prometheus: Prometheus) -> dict[str, int]:
    """Processes that answer, by job."""
    return {s["metric"]["job"]: int(s["value"][1]) for s in prometheus.query("sum by (job) (up)")}


def test_every_replica_is_found(prometheus: Prometheus) -> None:
    one = {keys.WORLD, keys.MANAGER, keys.ORCHESTRATOR, "router-sim", "router-radio", "prometheus"}
    wanted = dict.fromkeys(one, 1) | dict.fromkeys(keys.ROBOT_SERVICES, ROBOTS)
    until(lambda: up(prometheus) == wanted, "a job lacks processes", WITHIN_S)
    assert prometheus.query("max(orograph_figures_unnamed)")[0]["value"][1] == "0"


def test_every_panel_gets_data_from_the_cluster(prometheus: Prometheus) -> None:
    prometheus.await_data(questions(), WITHIN_S)


def test_each_robot_is_held_once_in_each_service(prometheus: Prometheus) -> None:
    for service in keys.ROBOT_SERVICES:
        held = f'sum(orograph_robots_held{{job="{service}"}}) == {ROBOTS}'
        until(lambda held=held: prometheus.query(held), f"{service} does not hold its robots", WITHIN_S)


def test_a_replica_that_comes_later_is_found_and_is_a_spare(cluster: Cluster, prometheus: Prometheus) -> None:
    cluster.compose("up", "--detach", "--no-recreate", "--no-deps", "--scale", f"laser={ROBOTS + 1}", "laser")
    until(lambda: up(prometheus).get("laser") == ROBOTS + 1, "the new laser is not scraped", WITHIN_S)
    until(
        lambda: prometheus.query('sum(orograph_claims_total{answer="refused"}) > 0'), "no claim was refused", WITHIN_S
    )
    assert float(prometheus.query('sum(orograph_robots_held{job="laser"})')[0]["value"][1]) == ROBOTS
