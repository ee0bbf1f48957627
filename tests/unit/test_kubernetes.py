"""ops/kubernetes: the file is what the code writes, the schema takes it, and it is the cluster of compose.yaml."""

from __future__ import annotations

import copy
import importlib.util
import runpy
from pathlib import Path
from typing import Any

import kubernetes_validate
import pytest
import yaml
from orograph import keys
from orograph.runtime.settings import VARIABLES

FOLDER = Path("ops/kubernetes")
RENDER = runpy.run_path(str(FOLDER / "render.py"))
VERSION = "1.31"
"""A release that is still run widely; the schema tool carries many."""
Manifest = dict[str, Any]


@pytest.fixture(scope="module")
def written() -> list[Manifest]:
    return [m for m in yaml.safe_load_all((FOLDER / "orograph.yaml").read_text()) if m]


def of_kind(manifests: list[Manifest], *kinds: str) -> dict[str, Manifest]:
    return {m["metadata"]["name"]: m for m in manifests if m["kind"] in kinds}


def pods(manifests: list[Manifest]) -> dict[str, Manifest]:
    return {name: m["spec"]["template"] for name, m in of_kind(manifests, "Job", "Deployment", "DaemonSet").items()}


def container(pod: Manifest) -> Manifest:
    (only,) = pod["spec"]["containers"]
    return only


def problems(manifests: list[Manifest]) -> list[str]:
    """What the schema does not know of: names that must meet, hardening, planes."""
    services, found = of_kind(manifests, "Service"), []
    for name, pod in pods(manifests).items():
        inside, labels = container(pod), pod["metadata"]["labels"]
        endpoints = {v["name"]: v["value"] for v in inside.get("env", []) if v["value"].startswith("tcp/")}
        peers = [a for a in inside["args"] if a.startswith("tcp/") and "0.0.0.0" not in a]
        for endpoint in (*endpoints.values(), *peers):
            host, _, port = endpoint.removeprefix("tcp/").rpartition(":")
            if host not in services or services[host]["spec"]["ports"][0]["port"] != int(port):
                found.append(f"{name}: nobody is at {endpoint}")
        secure = {**pod["spec"]["securityContext"], **inside["securityContext"]}
        if not (secure["runAsNonRoot"] and secure["readOnlyRootFilesystem"] and not secure["allowPrivilegeEscalation"]):
            found.append(f"{name}: not hardened")
        if secure["capabilities"] != {"drop": ["ALL"]} or pod["spec"]["automountServiceAccountToken"]:
            found.append(f"{name}: may too much")
        if not {v["name"] for v in inside.get("env", [])} <= set(VARIABLES):
            found.append(f"{name}: a variable nobody reads")
        service = name.removesuffix("-base")
        if ("orograph.io/radio" in labels) != (service in {*keys.RADIO_SERVICES, "router-radio"}):
            found.append(f"{name}: wrong plane")
        if importlib.util.find_spec(inside["args"][2]) is None:
            found.append(f"{name}: no module {inside['args'][2]}")
    for name, service in services.items():
        meant = [
            n
            for n, p in pods(manifests).items()
            if service["spec"]["selector"].items() <= p["metadata"]["labels"].items()
        ]
        found += [] if meant == [name] else [f"service {name} selects {meant}"]
    return found


def test_the_file_is_what_the_code_writes() -> None:
    text = RENDER["text"](RENDER["Wishes"]())
    assert (FOLDER / "orograph.yaml").read_text() == text, (
        "run: .venv/bin/python ops/kubernetes/render.py > ops/kubernetes/orograph.yaml"
    )


def test_the_schema_of_kubernetes_takes_it(written: list[Manifest]) -> None:
    for manifest in written:
        kubernetes_validate.validate(manifest, VERSION, strict=True)


@pytest.mark.parametrize("key", ["paralelism", "restartPolicy", "replicas"])
def test_the_schema_refuses_a_slip(written: list[Manifest], key: str) -> None:
    broken = copy.deepcopy(of_kind(written, "Job")["laser"])
    broken["spec"][key] = 1
    with pytest.raises(kubernetes_validate.ValidationError):
        kubernetes_validate.validate(broken, VERSION, strict=True)


def test_it_holds_every_service_and_a_router_of_each_plane_at_the_base_and_on_every_host(
    written: list[Manifest],
) -> None:
    assert set(of_kind(written, "Job")) == set(keys.SERVICES)
    assert set(of_kind(written, "DaemonSet")) == {"router-sim", "router-radio"}
    assert set(of_kind(written, "Deployment")) == {"router-sim-base", "router-radio-base"}
    assert problems(written) == []
    for plane in keys.PLANES:
        far = container(pods(written)[f"router-{plane}"])["args"]
        assert far[far.index("--peer") + 1] == f"tcp/router-{plane}-base:7447"
        assert of_kind(written, "Service")[f"router-{plane}"]["spec"]["internalTrafficPolicy"] == "Local"


def test_robots_and_scenario_are_wishes() -> None:
    made = RENDER["manifests"](RENDER["Wishes"](robots=7, scenario="paper", image="somewhere/orograph:1"))
    assert [of_kind(made, "Job")[s]["spec"]["parallelism"] for s in keys.ROBOT_SERVICES] == [7, 7, 7]
    arguments = container(pods(made)[keys.ORCHESTRATOR])["args"]
    assert arguments[arguments.index("--robots") + 1] == "7" and arguments[arguments.index("--scenario") + 1] == "paper"
    assert {container(pod)["image"] for pod in pods(made).values()} == {"somewhere/orograph:1"}
    assert "${" not in yaml.safe_dump_all(made)


def test_a_slip_in_what_the_schema_does_not_know_is_found(written: list[Manifest]) -> None:
    def after(change: Any) -> list[str]:
        broken = copy.deepcopy(written)
        change(pods(broken)["laser"], of_kind(broken, "Service")["router-sim"])
        return problems(broken)

    assert after(lambda pod, door: container(pod)["env"][0].update(value="tcp/router-sin:7447"))
    assert after(lambda pod, door: container(pod)["securityContext"].update(readOnlyRootFilesystem=False))
    assert after(lambda pod, door: container(pod)["securityContext"]["capabilities"].update(drop=[]))
    assert after(lambda pod, door: pod["metadata"]["labels"].update({"orograph.io/radio": "true"}))
    assert after(lambda pod, door: container(pod)["env"].append({"name": "DEBUG", "value": "1"}))
    assert after(lambda pod, door: container(pod)["args"].__setitem__(2, "services.lazer"))
    assert after(lambda pod, door: door["spec"]["selector"].update({"app.kubernetes.io/name": "router"}))
