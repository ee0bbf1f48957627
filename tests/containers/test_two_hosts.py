"""Two hosts: robots on networks that nothing but the routers' links joins to the rest; `orograph status` looks on."""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from containers.conftest import ROOT, Cluster, call, clusters, until
from orograph import keys
from orograph.launch.lifecycle import resolve, run
from orograph.storage.results import Summary
from orograph.storage.scenario_file import load_scenario
from ports import free_port

pytestmark = [pytest.mark.containers, pytest.mark.timeout(600)]
FAR = tuple(f"{service}-far" for service in keys.ROBOT_SERVICES)
PLANES = ("sim", "radio")
MISSION_S = 400.0


class TwoHosts(Cluster):
    """One robot here, one on the far host; the status port of the radio plane's router is open."""

    def __init__(self, time_scale: str) -> None:
        self.port = free_port()
        super().__init__(ROBOTS="2", SCENARIO="tiny", TIME_SCALE=time_scale, STATUS_PORT=str(self.port))

    def compose(self, *arguments: str, check: bool = True) -> subprocess.CompletedProcess[str]:
        return super().compose("--file", str(ROOT / "ops/two-hosts.compose.yaml"), *arguments, check=check)

    def networks(self, service: str) -> set[str]:
        """Of a service's first container."""
        inspected = call("docker", "inspect", "--format", "{{json .NetworkSettings.Networks}}", self.one(service))
        return {name.removeprefix(f"{self.project}_") for name in json.loads(inspected.stdout)}

    def one(self, service: str) -> str:
        (container,) = self.containers(service)
        return container

    def link(self, verb: str, plane: str) -> None:
        """`disconnect` or `connect` the far router's end of a plane's link."""
        call("docker", "network", verb, f"{self.project}_link-{plane}", self.one(f"router-{plane}-far"))

    def status(self) -> dict[str, Any] | None:
        """What `orograph status` says, None where nobody answers."""
        router = f"tcp/127.0.0.1:{self.port}"
        command = [sys.executable, "-m", "orograph.cli.main", "status", "--json", "--router", router]
        done = subprocess.run(command, capture_output=True, text=True, cwd=ROOT)
        return json.loads(done.stdout) if done.returncode == 0 else None

    def far_robot(self) -> str:
        """The robot that the far host maps for, "" while it has none."""
        return next(iter(self.holders("robot-mapping-far")), "")

    def silence_s(self, robot: str) -> float:
        """How long the orchestrator has not heard this robot's navigator; -1 if never, or if nobody says."""
        told = self.status() or {"robots": []}
        heard = {r["robot"]: r["drive_silent_s"] for r in told["robots"] if r["drive_silent_s"] is not None}
        return heard.get(robot, -1.0)


@pytest.fixture
def two_hosts(engine: None) -> Iterator[Callable[[str], TwoHosts]]:
    with clusters() as made:

        def make(time_scale: str) -> TwoHosts:
            cluster = TwoHosts(time_scale)
            made.append(cluster)
            cluster.compose("up", "--detach")  # how soon all is healthy is another test's question
            return cluster

        yield make


def summary(cluster: TwoHosts, out: Path) -> Summary:
    until(lambda: cluster.exit_code(cluster.one(keys.ORCHESTRATOR)) is not None, "no end", MISSION_S)
    cluster.await_end()
    return Summary.read(cluster.fetch(out))


def published(**wishes: str) -> list[tuple[str, str]]:
    """(service, address) of every port of the host that our own services would take."""
    config = json.loads(call(str(ROOT / "ops/compose"), "config", "--format", "json", env=wishes).stdout)
    return [
        (name, f"{port.get('host_ip', '')}:{port['published']}")
        for name, service in config["services"].items()
        for port in service.get("ports", [])
    ]


def test_the_status_port_is_off_by_default_and_the_loopbacks_alone() -> None:
    page = ("console", "127.0.0.1:8080")
    assert published(STATUS_PORT="") == [page]
    assert published(STATUS_PORT="17448") == [page, ("router-radio", "127.0.0.1:17448")]


def test_robots_on_two_hosts_make_the_map_of_one_process(two_hosts: Callable[[str], TwoHosts], tmp_path: Path) -> None:
    cluster = two_hosts("max")
    here = set().union(*(cluster.networks(service) for service in keys.SERVICES))
    there = set().union(*(cluster.networks(service) for service in FAR))
    assert here == {"sim", "radio"} and there == {"far-sim", "far-radio"}
    found = summary(cluster, tmp_path / "fetched")
    local = run(resolve(load_scenario("tiny"), 2, None, None), tmp_path / "local", in_process=True)
    assert found.complete and found.deterministic and found.copies_hash_equal and found.cells_lost == 0
    assert found.glrm_hash == Summary.read(local).glrm_hash


def test_a_cut_of_the_routers_links_heals_and_nothing_acknowledged_is_lost(
    two_hosts: Callable[[str], TwoHosts], tmp_path: Path
) -> None:
    cluster = two_hosts("1")
    robot = until(cluster.far_robot, "the far host holds a robot")
    for plane in reversed(PLANES):
        until(lambda: 0 <= cluster.silence_s(robot) < 3, f"{robot} is not heard")
        cluster.link("disconnect", plane)
        until(lambda: cluster.silence_s(robot) > 4, f"the cut of the {plane} link is not seen")
        told = cluster.status()
        assert told is not None and told["phase"] == "mapping"
        cluster.link("connect", plane)
        until(lambda: 0 <= cluster.silence_s(robot) < 3, f"{robot} does not come back on the {plane} plane")
    found = summary(cluster, tmp_path)
    # The robots stood still during the cuts: whether the patrol's time sufficed is not the question.
    assert found.copies_hash_equal and found.glrm_is_own_fold
    assert (found.cells_lost, found.missing_parts) == (0, ())
    assert cluster.status() is None
