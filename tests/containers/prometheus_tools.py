"""Prometheus and promtool as this machine has them: Debian's package on the path, else the image of compose.yaml."""

from __future__ import annotations

import json
import math
import os
import shutil
import subprocess
import time
import urllib.error
import urllib.parse
import urllib.request
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from functools import cache
from pathlib import Path
from typing import Any

import pytest
import yaml
from ports import free_port

ROOT = Path(__file__).parents[2]
OPS = ROOT / "ops/prometheus"
LABEL = "orograph.test=watch"
START_S = 60.0


def image() -> str:
    """Prometheus's image as compose.yaml names it."""
    return str(yaml.safe_load((ROOT / "compose.yaml").read_text())["services"]["prometheus"]["image"])


@cache
def _make_image() -> str:
    """Make sure of Prometheus's image; returns why there is none."""
    made = subprocess.run([ROOT / "ops/offline-images", "prometheus"], capture_output=True, text=True, timeout=240)
    return made.stderr.strip() if made.returncode else ""


def command(name: str, mounts: Sequence[Path] = (), cidfile: Path | None = None) -> list[str]:
    """Start of a command line that runs `prometheus` or `promtool`; fails where neither form is to be had."""
    if (found := shutil.which(name)) is not None:
        return [found]
    if problem := _make_image():
        pytest.fail(f"no {name} on the path, and no image of it: {problem}", pytrace=False)
    binds = [option for path in (OPS, *mounts) for option in ("--volume", f"{path}:{path}")]
    return [
        "docker", "run", "--rm", "--interactive", "--label", LABEL, "--network", "host",
        "--user", f"{os.getuid()}:{os.getgid()}", "--workdir", str(OPS), "--entrypoint", f"/bin/{name}", *binds,
        *(["--cidfile", str(cidfile)] if cidfile else []), image(),
    ]  # fmt: skip


def promtool(*arguments: str, stdin: str = "", mounts: Sequence[Path] = ()) -> subprocess.CompletedProcess[str]:
    """Run promtool in ops/prometheus."""
    return subprocess.run(
        [*command("promtool", mounts), *arguments], cwd=OPS, input=stdin, capture_output=True, text=True, timeout=120
    )


def questions() -> dict[str, str]:
    """Panel and legend -> PromQL with Grafana's variables filled in, of every dashboard."""
    out = {}
    for file in sorted((ROOT / "ops/grafana/dashboards").glob("*.json")):
        for panel in json.loads(file.read_text())["panels"]:
            for target in panel.get("targets", []):
                expression = target["expr"].replace("$__rate_interval", "10s").replace("$robot", ".*")
                assert "$" not in expression, expression
                out[f"{file.stem} / {panel['title']} / {target['refId']}"] = expression
    return out


class Prometheus:
    """A running server's HTTP API."""

    def __init__(self, url: str) -> None:
        self._url = url

    def ask(self, path: str, **parameters: str) -> Any:
        """The `data` of an answer; raises AssertionError with Prometheus's own words for a refused query."""
        query = urllib.parse.urlencode(parameters)
        try:
            with urllib.request.urlopen(f"{self._url}/api/v1/{path}?{query}", timeout=10) as answer:
                return json.load(answer)["data"]
        except urllib.error.HTTPError as error:
            raise AssertionError(f"{parameters}: {error.read().decode()}") from None

    def query(self, expression: str) -> list[dict[str, Any]]:
        """The samples of an expression now."""
        result: list[dict[str, Any]] = self.ask("query", query=expression)["result"]
        return result

    def has_data(self, expression: str) -> bool:
        """Whether an expression has a sample now that is a number."""
        return any(not math.isnan(float(sample["value"][1])) for sample in self.query(expression))

    def await_data(self, wanted: Mapping[str, str], within_s: float, check: Callable[[], None] = lambda: None) -> None:
        """Poll until each expression (by what it is for) had data once; one that is refused fails at once."""
        deadline_s, silent = time.monotonic() + within_s, dict(wanted)
        while silent := {what: expression for what, expression in silent.items() if not self.has_data(expression)}:
            check()
            assert time.monotonic() < deadline_s, f"no data for {silent}"
            time.sleep(0.5)

    def ready(self) -> bool:
        """Whether it serves."""
        try:
            with urllib.request.urlopen(f"{self._url}/-/ready", timeout=5) as answer:
                return bool(answer.status == 200)
        except OSError:
            return False


def local_config(targets: Mapping[str, Sequence[str]], own: str) -> dict[str, Any]:
    """The checked-in configuration with DNS replaced by loopback targets (job -> addresses), scraping each second."""
    config: dict[str, Any] = yaml.safe_load((OPS / "prometheus.yml").read_text())
    config["global"] = {"scrape_interval": "1s", "evaluation_interval": "1s"}
    config["rule_files"] = [str(OPS / "rules/*.yml")]
    jobs = [job["job_name"] for job in config["scrape_configs"]]
    assert set(targets) == set(jobs) - {"prometheus"}, (sorted(targets), jobs)
    everywhere = {**targets, "prometheus": [own]}
    config["scrape_configs"] = [{"job_name": j, "static_configs": [{"targets": list(everywhere[j])}]} for j in jobs]
    return config


@contextmanager
def running(targets: Mapping[str, Sequence[str]], folder: Path) -> Iterator[Prometheus]:
    """A Prometheus that scrapes these targets, on a loopback port, ended with the block."""
    own = f"127.0.0.1:{free_port()}"
    (folder / "prometheus.yml").write_text(yaml.safe_dump(local_config(targets, own)))
    cidfile, log = folder / "cid", folder / "prometheus.log"
    line = [
        *command("prometheus", [folder], cidfile), f"--config.file={folder / 'prometheus.yml'}",
        f"--storage.tsdb.path={folder / 'tsdb'}", f"--web.listen-address={own}", "--log.level=warn",
    ]  # fmt: skip
    with log.open("wb") as out:
        process = subprocess.Popen(line, stdin=subprocess.DEVNULL, stdout=out, stderr=out)
    try:
        server = Prometheus(f"http://{own}")
        deadline_s = time.monotonic() + START_S
        while not server.ready():
            assert process.poll() is None and time.monotonic() < deadline_s, log.read_text()
            time.sleep(0.1)
        yield server
    finally:
        process.terminate()
        try:
            process.wait(15)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()
        if cidfile.exists():
            subprocess.run(["docker", "rm", "--force", cidfile.read_text()], capture_output=True)
