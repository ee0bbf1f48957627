"""Clusters of a test's own: real containers under a project name nobody else has, gone at the end whatever happens."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import uuid
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import polling
import pytest

ROOT = Path(__file__).parents[2]
COMPOSE = ROOT / "ops" / "compose"
DEADLINE_S = 240.0


def call(*command: str, env: dict[str, str] | None = None, check: bool = True) -> subprocess.CompletedProcess[str]:
    done = subprocess.run(command, env={**os.environ, **(env or {})}, capture_output=True, text=True, cwd=ROOT)
    assert not check or done.returncode == 0, f"{' '.join(command)}\n{done.stdout}\n{done.stderr}"
    return done


def until(condition: Callable[[], Any], what: str, seconds: float = DEADLINE_S) -> Any:
    return polling.until(condition, what, seconds, poll_s=0.2)


class Cluster:
    """One Compose project; `wishes` are the interpolation variables of compose.yaml."""

    def __init__(self, **wishes: str) -> None:
        self.project = f"orograph-test-{uuid.uuid4().hex[:8]}"
        self._wishes = {"COMPOSE_PROJECT_NAME": self.project, "CONSOLE_PORT": "0", **wishes}

    def compose(self, *arguments: str, check: bool = True) -> subprocess.CompletedProcess[str]:
        return call(str(COMPOSE), *arguments, env=self._wishes, check=check)

    def up(self, *arguments: str, within_s: int = 60) -> None:
        """Start and wait until everything is healthy."""
        self.compose("up", "--detach", "--wait", "--wait-timeout", str(within_s), *arguments)

    def containers(self, service: str) -> list[str]:
        """Ids of a service's containers, ended ones too, in the order of their numbers."""
        rows = [json.loads(line) for line in self._ps(service)]
        return [row["ID"] for row in sorted(rows, key=lambda r: int(r["Name"].rsplit("-", 1)[1]))]

    def _ps(self, service: str) -> list[str]:
        return self.compose("ps", "--all", "--format", "json", service).stdout.splitlines()

    def logs(self, container: str) -> str:
        done = call("docker", "logs", container)
        return done.stdout + done.stderr

    def inside(self, container: str, script: str, check: bool = True) -> str:
        return call("docker", "exec", container, "sh", "-c", script, check=check).stdout

    def holders(self, service: str) -> dict[str, str]:
        """Robot -> container of `service` that took it last; a container's lines begin with their time."""
        ready = [(line, c) for c in self.containers(service) for line in self.logs(c).splitlines() if "ready: " in line]
        return {line.rsplit("/", 1)[1]: container for line, container in sorted(ready)}

    def exit_code(self, container: str) -> int | None:
        """None while it runs."""
        state = json.loads(call("docker", "inspect", "--format", "{{json .State}}", container).stdout)
        return None if state["Running"] or state["Restarting"] else int(state["ExitCode"])

    def await_end(self) -> None:
        """The run has ended and its report is made: the orchestrator is the last to go."""
        (container,) = self.containers("orchestrator")
        code = until(lambda: (self.exit_code(container),) if self.exit_code(container) is not None else None, "no end")
        assert code == (0,), self.logs(container)

    def fetch(self, out: Path) -> Path:
        """Copy the newest run folder out and return it."""
        report = call(str(ROOT / "ops" / "fetch-run"), str(out), env=self._wishes).stdout.strip()
        return Path(report).parent

    def down(self) -> None:
        """Thrice if need be: a loaded engine may still hold a network that its last container has left."""
        command = ("--profile", "*", "down", "--volumes", "--remove-orphans", "--timeout", "2")
        if all(self.compose(*command, check=False).returncode for _ in range(3)):
            print(f"{self.project}: {self.compose(*command, check=False).stderr}", file=sys.stderr)


@contextmanager
def clusters() -> Iterator[list[Cluster]]:
    """A list of clusters, all of which are gone at the end."""
    made: list[Cluster] = []
    try:
        yield made
    finally:
        for cluster in made:
            cluster.down()


@pytest.fixture(scope="session")
def engine() -> None:
    """A Docker engine with Compose and the image of this tree; without them the tests fail, they are not skipped."""
    there = call(str(COMPOSE), "version", check=False)
    if there.returncode != 0:
        pytest.fail(there.stderr.strip(), pytrace=False)
    signal.signal(signal.SIGTERM, lambda *_: pytest.exit("told to end", 143))  # the clusters go as well
    call(str(ROOT / "ops" / "offline-images"))
    call("docker", "build", "--quiet", "--file", "ops/Dockerfile", "--tag", "orograph", ".")


@pytest.fixture(scope="module")
def start(engine: None) -> Iterator[Callable[..., Cluster]]:
    """Make clusters; all of them are gone at the module's end."""
    with clusters() as made:

        def make(**wishes: str) -> Cluster:
            made.append(Cluster(**wishes))
            return made[-1]

        yield make
