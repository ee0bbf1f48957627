"""compose.yaml, as Compose resolves it, holds the house's rules; each rule is shown once to be able to fail."""

from __future__ import annotations

import copy
import json
from collections.abc import Callable, Iterator
from typing import Any

import pytest
from containers.conftest import COMPOSE, ROOT, call
from orograph import keys
from orograph.runtime.settings import VARIABLES

pytestmark = pytest.mark.containers
Config = dict[str, Any]
ROUTERS = {"router-sim", "router-radio"}
CONSOLE = "console"
ASIDE = {CONSOLE, "recorder"}
OURS = {*keys.SERVICES, *ROUTERS, *ASIDE}
ON_RADIO = {*keys.RADIO_SERVICES, "router-radio", *ASIDE}
WATCHES = {"prometheus"}
"""May be on the radio plane's network to read a router's figures; no robot's message passes it."""
DASHBOARDS = {"prometheus", "grafana"}
PUBLISHED = {*DASHBOARDS, CONSOLE}


@pytest.fixture(scope="module")
def config(engine: None) -> Config:
    shown = call(str(COMPOSE), "--profile", "*", "config", "--format", "json", env={"ROBOTS": "10"})
    return json.loads(shown.stdout)


def problems(config: Config) -> list[str]:
    """Everything that is against the rules, as `service: what`."""
    found = [f"{name}: {what}" for name, service in config["services"].items() for what in _any(name, service)]
    found += [f"{name}: {what}" for name in OURS for what in _ours(name, config["services"].get(name, {}))]
    found += [f"network {n}: not internal" for n in ("sim", "radio") if not config["networks"][n].get("internal")]
    if set(config["services"]) != OURS | DASHBOARDS:
        found.append(f"services are {sorted(config['services'])}")
    return found


def _any(name: str, service: Config) -> Iterator[str]:
    if "container_name" in service:
        yield "a container_name"
    if service.get("privileged") or service.get("network_mode") == "host" or service.get("pid") == "host":
        yield "shares the host"
    if any("docker.sock" in json.dumps(volume) for volume in service.get("volumes", [])):
        yield "holds the engine's socket"
    if service.get("cap_drop") != ["ALL"] or service.get("cap_add"):
        yield "capabilities"
    if service.get("security_opt") != ["no-new-privileges:true"]:
        yield "new privileges"
    if not service.get("read_only"):
        yield "a root that can be written"
    if not int(service.get("mem_limit", 0)) or not 0 < int(service.get("pids_limit") or 0) <= 128:
        yield "no limits"
    for port in service.get("ports", []):
        if name not in PUBLISHED or port.get("host_ip") != "127.0.0.1":
            yield "a port of the host"
    if service.get("secrets") or any(
        w in v.upper() for v in service.get("environment", {}) for w in ("SECRET", "KEY", "TOKEN")
    ):
        yield "a secret"
    networks = set(service.get("networks", {}))
    if ("radio" in networks) != (name in ON_RADIO) and name not in WATCHES:
        yield "on the wrong side of the radio"


def _ours(name: str, service: Config) -> Iterator[str]:
    if service.get("user") != "10001:10001":
        yield "its user"
    if not service.get("init"):
        yield "no init"
    if not any(t.startswith("/tmp:") and "noexec" in t for t in service.get("tmpfs", [])):
        yield "its /tmp"
    if "/tmp/ready" not in json.dumps(service.get("healthcheck", {})):
        yield "no healthcheck that means ready"
    if not service.get("restart", "").startswith("on-failure") and name != keys.WORLD:
        yield "no restart"
    module = "router" if name in ROUTERS else name.replace("-", "_")
    if service.get("command", [])[:3] != ["python", "-m", f"services.{module}"]:
        yield "another module"
    if not set(service.get("environment") or {}) <= set(VARIABLES):
        yield "unknown variables"
    if name in keys.ROBOT_SERVICES and service.get("deploy", {}).get("replicas") != 10:
        yield "ROBOTS does not scale it"


def test_compose_yaml_holds_the_rules(config: Config) -> None:
    assert problems(config) == []


def test_every_service_has_its_module_and_every_module_its_service() -> None:
    modules = {path.stem for path in (ROOT / "services").glob("*.py")} - {"__init__"}
    assert modules == {name.replace("-", "_") for name in keys.SERVICES} | {"router", *ASIDE}


def _edit(service: str, **changes: Any) -> Callable[[Config], None]:
    return lambda config: config["services"][service].update(changes)


def _environment(name: str) -> Callable[[Config], None]:
    return lambda config: config["services"]["laser"]["environment"].update({name: "x"})


MUTANTS: dict[str, Callable[[Config], None]] = {
    "world: a container_name": _edit("world", container_name="world"),
    "laser: shares the host": _edit("laser", network_mode="host"),
    "navigator: holds the engine's socket": _edit("navigator", volumes=[{"source": "/var/run/docker.sock"}]),
    "map-manager: capabilities": _edit("map-manager", cap_add=["NET_ADMIN"]),
    "router-sim: new privileges": _edit("router-sim", security_opt=[]),
    "world: a root that can be written": _edit("world", read_only=False),
    "orchestrator: no limits": _edit("orchestrator", mem_limit="0"),
    "router-radio: a port of the host": _edit("router-radio", ports=[{"host_ip": "127.0.0.1", "target": 7447}]),
    "console: a port of the host": _edit("console", ports=[{"host_ip": "0.0.0.0", "target": 8080}]),
    "laser: a secret": _environment("API_TOKEN"),
    "laser: unknown variables": _environment("ROBOT_ID"),
    "laser: on the wrong side of the radio": _edit("laser", networks={"sim": None, "radio": None}),
    "navigator: on the wrong side of the radio": _edit("navigator", networks={"sim": None}),
    "world: its user": _edit("world", user="0:0"),
    "world: no init": _edit("world", init=False),
    "world: its /tmp": _edit("world", tmpfs=["/tmp"]),
    "world: no healthcheck that means ready": _edit("world", healthcheck={}),
    "laser: no restart": _edit("laser", restart="no"),
    "laser: another module": _edit("laser", command=["python", "-m", "services.navigator"]),
    "laser: ROBOTS does not scale it": _edit("laser", deploy={"replicas": 1}),
    "network sim: not internal": lambda config: config["networks"]["sim"].update(internal=False),
}  # fmt: skip


@pytest.mark.parametrize("problem", MUTANTS)
def test_each_rule_can_fail(config: Config, problem: str) -> None:
    mutant = copy.deepcopy(config)
    MUTANTS[problem](mutant)
    assert problem in problems(mutant)
