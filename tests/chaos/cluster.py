"""One Compose project per experiment: containers under a name nobody else has, gone at the end whatever happens."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tarfile
import tempfile
import time
import uuid
from collections.abc import Callable, Mapping
from pathlib import Path
from types import TracebackType
from typing import Any

from orograph.storage.run_folder import LATEST

ROOT = Path(__file__).parents[2]
COMPOSE = ROOT / "ops" / "compose"
CHAOS = Path(__file__).parent
DOWN_ATTEMPTS = 3
POLL_S = 0.5
"""Between questions to Docker, each of which is a process."""


class ChaosError(Exception):
    """The experiment itself could not be carried out; that is no verdict on the product."""


def call(*command: str, env: Mapping[str, str] | None = None, check: bool = True) -> str:
    """Standard output and error of a command; raises ChaosError with them where it fails."""
    done = subprocess.run(
        command, env={**os.environ, **(env or {})}, cwd=ROOT, text=True, timeout=240,
        stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.STDOUT,
    )  # fmt: skip
    if check and done.returncode != 0:
        raise ChaosError(f"{' '.join(command)}: {done.stdout.strip()[-1500:]}")
    return done.stdout


def until(condition: Callable[[], Any], what: str, within_s: float, poll_s: float = POLL_S) -> Any:
    """Poll until the condition holds and return it; raises ChaosError naming what never came."""
    deadline_s = time.monotonic() + within_s
    while not (found := condition()):
        if time.monotonic() > deadline_s:
            raise ChaosError(f"not within {within_s:.0f} s: {what}")
        time.sleep(poll_s)
    return found


class Cluster:
    """`wishes` are the interpolation variables of compose.yaml, `overlay` more of a compose file."""

    def __init__(self, wishes: Mapping[str, str], overlay: Mapping[str, Any]) -> None:
        self.project = f"orograph-chaos-{uuid.uuid4().hex[:8]}"
        self._env = {"COMPOSE_PROJECT_NAME": self.project, "CHAOS_DIR": str(CHAOS), **wishes}
        self._folder = tempfile.TemporaryDirectory(prefix=f"{self.project}-")
        self._files = ["--file", str(CHAOS / "chaos.compose.yaml")]
        if overlay:
            path = Path(self._folder.name) / "overlay.json"
            path.write_text(json.dumps(overlay))
            self._files += ["--file", str(path)]

    def __enter__(self) -> Cluster:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, _: TracebackType | None) -> None:
        if isinstance(error, ChaosError):
            print(self.last_words(), file=sys.stderr, flush=True)
        self._down()
        self._folder.cleanup()

    def _down(self) -> None:
        """On a loaded machine the engine may hold a network that its last container has left, once in a while for good
        (until the daemon is restarted): that is said, and is no verdict on the product.
        """
        for _ in range(DOWN_ATTEMPTS):
            try:
                self.compose("--profile", "*", "down", "--volumes", "--remove-orphans", "--timeout", "1")
                return
            except ChaosError as error:
                print(f"the engine does not let go: {error}", file=sys.stderr, flush=True)

    def compose(self, *arguments: str, check: bool = True) -> str:
        """Run Compose on this project."""
        return call(str(COMPOSE), *self._files, *arguments, env=self._env, check=check)

    def network(self, plane: str) -> str:
        """Docker's name of a network of compose.yaml."""
        return f"{self.project}_{plane}"

    def containers(self, service: str) -> list[str]:
        """Ids of a service's containers, ended ones too, oldest first."""
        labels = {"project": self.project, "service": service}
        filters = [word for k, v in labels.items() for word in ("--filter", f"label=com.docker.compose.{k}={v}")]
        return call("docker", "ps", "--all", "--quiet", "--no-trunc", *filters).split()[::-1]

    def only(self, service: str) -> str:
        """The one container of a service; raises ChaosError where there is none, or more."""
        found = self.containers(service)
        if len(found) != 1:
            raise ChaosError(f"{len(found)} containers of {service}, expected one")
        return found[0]

    def states(self) -> list[tuple[str, str]]:
        """(service, Docker's word for its state) of every container but those of `compose run`."""
        told = call(
            "docker", "ps", "--all", "--filter", f"label=com.docker.compose.project={self.project}",
            "--filter", "label=com.docker.compose.oneoff=False",
            "--format", '{{.Label "com.docker.compose.service"}} {{.State}}',
        )  # fmt: skip
        return [(service, state) for service, state in (line.split() for line in told.splitlines())]

    def holders(self, service: str) -> dict[str, str]:
        """Robot -> container of `service` whose last word says that it holds the robot."""
        found = {}
        for container in self.containers(service):
            ready = [line for line in self.logs(container).splitlines() if "ready: " in line]
            if ready:
                found[ready[-1].rsplit("/", 1)[1]] = container
        return found

    def holder(self, service: str, robot: str) -> str:
        """The container that holds a robot; raises ChaosError where there is none."""
        return str(until(lambda: self.holders(service).get(robot), f"{service} of {robot}", 20))

    def logs(self, container: str) -> str:
        """All it ever said."""
        return call("docker", "logs", container)

    def last_words(self) -> str:
        """A line for each container: its state and what it said last."""
        project = f"label=com.docker.compose.project={self.project}"
        told = call("docker", "ps", "--all", "--filter", project, "--format", "{{.Names}} {{.Status}}", check=False)
        lines = []
        for name, status in (line.split(" ", 1) for line in told.splitlines()):
            last = call("docker", "logs", "--tail", "1", name, check=False).strip()
            lines.append(f"  {name.removeprefix(self.project + '-')}: {status}: {last[:160]}")
        return "\n".join(sorted(lines))

    def state(self, container: str) -> dict[str, Any]:
        """Docker's account of a container: Running, ExitCode, OOMKilled, Pid and more."""
        found: dict[str, Any] = json.loads(call("docker", "inspect", "--format", "{{json .State}}", container))
        return found

    def restarts(self, container: str) -> int:
        """How often its restart policy started it again."""
        return int(call("docker", "inspect", "--format", "{{.RestartCount}}", container))

    def kill_inside(self, container: str) -> None:
        """kill -9 of the service process itself, so that the restart policy sees a crash."""
        call("docker", "exec", container, "sh", "-c", "kill -9 $(cat /proc/1/task/1/children)")

    def fetch(self, out: Path) -> Path:
        """Copy the newest run folder, whatever there is of it, to `out` and return its path."""
        orchestrator = self.only("orchestrator")
        name = self._read(orchestrator, f"/run/orograph/{LATEST}").decode().strip()
        call("docker", "cp", f"{orchestrator}:/run/orograph/{name}", str(out))
        return out / name

    def _read(self, container: str, path: str) -> bytes:
        with tempfile.TemporaryFile() as archive:
            done = subprocess.run(["docker", "cp", f"{container}:{path}", "-"], stdout=archive, stderr=subprocess.PIPE)
            if done.returncode != 0:
                raise ChaosError(f"{path} of {container[:12]}: {done.stderr.decode().strip()}")
            archive.seek(0)
            with tarfile.open(fileobj=archive) as tar:
                member = tar.extractfile(tar.getmembers()[0])
                assert member is not None
                return member.read()
