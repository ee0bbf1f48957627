"""A real Prometheus on a running mission: all is scraped, every panel gets data, every rule evaluates.

Rendering is what is not tested: that Grafana itself draws the panels. The test says so in its output.
"""

from __future__ import annotations

import threading
import urllib.request
from collections import defaultdict
from collections.abc import Iterator
from pathlib import Path

import pytest
import yaml
from containers.prometheus_tools import OPS, Prometheus, promtool, questions, running
from orograph import keys
from orograph.launch import processes as launch
from orograph.launch.lifecycle import prepare_out, resolve
from orograph.launch.supervisor import Child, Supervisor
from orograph.storage.scenario_file import load_scenario
from ports import free_port

pytestmark = pytest.mark.containers
DEADLINE_S = 50.0
JOBS = {*keys.SERVICES, "router-sim", "router-radio"}


class Enough(Exception):  # noqa: N818 - no error: the test has seen what it wanted
    """Ends the mission from its progress view."""


class Mission:
    """A paced mission of `tiny` in a thread of its own, each service with a metrics port."""

    def __init__(self, out: Path) -> None:
        self.targets: defaultdict[str, list[str]] = defaultdict(list)
        self.started, self._stop = threading.Event(), threading.Event()
        self.error: BaseException | None = None
        self._out = out
        self._thread = threading.Thread(target=self._run)

    def __enter__(self) -> Mission:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._stop.set()
        self._thread.join(30)

    def meter(self, name: str, arguments: tuple[str, ...]) -> tuple[str, ...]:
        address = f"127.0.0.1:{free_port()}"
        job = next(job for job in sorted(JOBS) if name == job or name.startswith(f"{job}-"))
        self.targets[job].append(address)
        return (*arguments, "--metrics-port", address)

    def _run(self) -> None:
        scenario = resolve(load_scenario("scenarios/tiny"), None, None, "1.0")
        try:
            out = prepare_out(self._out, scenario)
            with launch.started(scenario, out, 1) as (supervisor, sim):
                self.started.set()
                launch.follow(supervisor, sim, out, self._on_progress)
        except Enough:
            pass
        except BaseException as error:  # judged by the test, in its own thread
            self.error = error
        finally:
            self.started.set()

    def _on_progress(self, figures: launch.Figures, restarts: list[str]) -> None:
        if self._stop.is_set():
            raise Enough


@pytest.fixture(scope="module")
def mission(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Mission]:
    told = Mission(tmp_path_factory.mktemp("mission") / "run")

    class Metered(Supervisor):
        def start(self, name: str, module: str, *arguments: str, essential: bool = False) -> Child:
            return super().start(name, module, *told.meter(name, arguments), essential=essential)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(launch, "Supervisor", Metered)
        with told:
            assert told.started.wait(30) and told.error is None, told.error
            yield told


@pytest.fixture(scope="module")
def prometheus(mission: Mission, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Prometheus]:
    with running(mission.targets, tmp_path_factory.mktemp("prometheus")) as server:
        yield server


def rules() -> dict[str, tuple[str, str]]:
    """Name -> (kind, PromQL) of every rule."""
    files = [yaml.safe_load(f.read_text()) for f in sorted((OPS / "rules").glob("*.yml"))]
    every = [rule for file in files for group in file["groups"] for rule in group["rules"]]
    return {r.get("alert") or r["record"]: ("alert" if "alert" in r else "record", r["expr"]) for r in every}


def await_data(prometheus: Prometheus, mission: Mission, wanted: dict[str, str]) -> None:
    """Poll until each expression has a value, while the mission is well."""

    def check() -> None:
        assert mission.error is None, mission.error

    prometheus.await_data(wanted, DEADLINE_S, check)


def test_every_process_is_scraped(prometheus: Prometheus, mission: Mission) -> None:
    assert set(mission.targets) == JOBS
    processes = sum(map(len, mission.targets.values()))
    assert processes == 2 + 3 + 3 * 2
    up = {f"{job}: {len(t)}": f'sum(up{{job="{job}"}}) == {len(t)}' for job, t in mission.targets.items()}
    await_data(prometheus, mission, up)
    assert prometheus.query("max(orograph_figures_unnamed)")[0]["value"][1] == "0"


def test_every_panel_gets_data(prometheus: Prometheus, mission: Mission, capsys: pytest.CaptureFixture[str]) -> None:
    wanted = questions()
    assert len(wanted) > 70
    await_data(prometheus, mission, wanted)
    with capsys.disabled():
        print(f"\n{len(wanted)} queries of 3 dashboards got data from Prometheus. NOT tested: Grafana itself, that is"
              " provisioning and rendering; its image is not part of these tests.")  # fmt: skip


def test_every_rule_evaluates(prometheus: Prometheus, mission: Mission) -> None:
    recorded = {name: name for name, (kind, _) in rules().items() if kind == "record"}
    await_data(prometheus, mission, recorded)
    loaded = {r["name"]: r for group in prometheus.ask("rules")["groups"] for r in group["rules"]}
    assert set(loaded) == set(rules())
    for name, (_, expression) in rules().items():
        prometheus.query(expression)
        assert (loaded[name]["health"], loaded[name].get("lastError", "")) == ("ok", ""), loaded[name]


def test_the_checkers_can_fail(prometheus: Prometheus, mission: Mission) -> None:
    with pytest.raises(AssertionError, match="parse error"):
        await_data(prometheus, mission, {"broken": "rate(orograph_map_version[10s]"})
    assert not prometheus.has_data("orograph_no_such_metric")
    assert not prometheus.has_data("0 * sum(up) / 0")


def test_promtool_accepts_what_each_service_exports(prometheus: Prometheus, mission: Mission) -> None:
    for job in sorted(JOBS):
        with urllib.request.urlopen(f"http://{mission.targets[job][0]}/metrics", timeout=10) as answer:
            text = answer.read().decode()
        assert "orograph_" in text and "process_resident_memory_bytes" in text
        checked = promtool("check", "metrics", stdin=text)
        # Problems of metrics that are not ours (python_info and the like) are none of ours.
        ours = [line for line in checked.stderr.splitlines() if line.startswith("orograph_")]
        assert checked.returncode in {0, 3} and not ours, (job, checked.stderr, checked.stdout)


def test_promtool_check_can_fail() -> None:
    checked = promtool(
        "check", "metrics", stdin="# HELP orograph_age_ms Age.\n# TYPE orograph_age_ms gauge\norograph_age_ms 1\n"
    )
    assert checked.returncode == 3 and "orograph_age_ms" in checked.stderr + checked.stdout


def test_the_rules_and_the_configuration_are_valid() -> None:
    for arguments in (
        ["check", "rules", "rules/alerts.yml", "rules/recording.yml"],
        ["check", "config", "prometheus.yml"],
    ):
        checked = promtool(*arguments)
        assert checked.returncode == 0, checked.stderr + checked.stdout


def test_each_alert_fires_and_does_not_fire() -> None:
    tested = promtool("test", "rules", "tests/alerts.yml")
    assert tested.returncode == 0 and "SUCCESS" in tested.stdout, tested.stderr + tested.stdout


def test_an_alert_that_does_not_fire_turns_its_test_red(tmp_path: Path) -> None:
    """Each alert made deaf in turn: the histories notice."""
    alerts = yaml.safe_load((OPS / "rules/alerts.yml").read_text())
    for rule in alerts["groups"][0]["rules"]:
        assert mutated_tests_fail(tmp_path, rule["alert"], f"({rule['expr']}) and on () vector(1) > 2"), rule["alert"]


def mutated_tests_fail(folder: Path, alert: str, expression: str) -> bool:
    alerts = yaml.safe_load((OPS / "rules/alerts.yml").read_text())
    for rule in alerts["groups"][0]["rules"]:
        rule["expr"] = expression if rule["alert"] == alert else rule["expr"]
    (folder / "alerts.yml").write_text(yaml.safe_dump(alerts))
    tests = yaml.safe_load((OPS / "tests/alerts.yml").read_text())
    tests["rule_files"] = [str(OPS / "rules/recording.yml"), str(folder / "alerts.yml")]
    (folder / "tests.yml").write_text(yaml.safe_dump(tests))
    tested = promtool("test", "rules", str(folder / "tests.yml"), mounts=[folder])
    return tested.returncode == 1 and f"alertname: {alert}" in tested.stderr + tested.stdout
