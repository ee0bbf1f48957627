"""What the kernel says of running containers: no capability, no new privilege, nobody's user, nothing to write to."""

from __future__ import annotations

import re
from collections.abc import Callable

import pytest
from containers.conftest import Cluster
from orograph import keys

pytestmark = pytest.mark.containers
SERVICES = (*keys.SERVICES, "router-sim", "router-radio")
STATUS = """for p in /proc/[0-9]*; do
  tr '\\0' ' ' < $p/cmdline | grep -q '^python -m services' || continue
  grep -E 'Uid|CapEff|CapBnd|NoNewPrivs|Seccomp:' $p/status
done; grep -E ' (/|/tmp) ' /proc/mounts; cat /proc/1/cmdline | tr '\\0' ' '"""
WRITES = "touch /opt/orograph/x 2>/dev/null || touch /x 2>/dev/null || touch /var/x 2>/dev/null || echo nowhere"
RUNS = "printf '#!/bin/sh\\necho ran\\n' > /tmp/x; chmod +x /tmp/x; /tmp/x 2>/dev/null || echo refused"


@pytest.fixture(scope="module")
def cluster(start: Callable[..., Cluster]) -> Cluster:
    made = start(ROBOTS="1", SCENARIO="tiny", TIME_SCALE="0.2")
    made.up()
    return made


@pytest.mark.parametrize("service", SERVICES)
def test_a_running_container_can_do_nothing_but_its_work(cluster: Cluster, service: str) -> None:
    (container,) = cluster.containers(service)
    said = cluster.inside(container, STATUS)
    assert re.search(r"Uid:\s+10001\s+10001\s+10001\s+10001", said), said
    assert re.search(r"CapEff:\s+0+\n", said) and re.search(r"CapBnd:\s+0+\n", said), said
    assert re.search(r"NoNewPrivs:\s+1", said) and re.search(r"Seccomp:\s+2", said), said
    assert re.search(r" / \S+ ro[ ,]", said) and re.search(r" /tmp tmpfs \S*noexec", said), said
    assert "init" in said.splitlines()[-1]
    assert cluster.inside(container, WRITES).strip() == "nowhere"
    assert cluster.inside(container, RUNS).strip() == "refused"


def test_only_who_should_hears_the_radio(cluster: Cluster) -> None:
    script = (
        "timeout 2 python -c \"import socket; socket.create_connection(('router-radio', 7447), 1); print('heard')\""
    )
    for service in SERVICES:
        (container,) = cluster.containers(service)
        heard = "heard" in cluster.inside(container, script, check=False)
        assert heard == (service in (*keys.RADIO_SERVICES, "router-radio")), service
