"""Writes the cluster of compose.yaml as Kubernetes manifests: any number of hosts, a router of each plane on every one.

    .venv/bin/python ops/kubernetes/render.py --robots 6 --scenario paper --image registry.example/orograph:1 > my.yaml

ops/kubernetes/orograph.yaml is what it writes without arguments; a test holds the file to it, and both to the schema.
"""

from __future__ import annotations

import argparse
import re
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import yaml
from orograph import keys

ROOT = Path(__file__).parents[2]
NAMESPACE = "orograph"
ROUTER_PORT, METRICS_PORT = 7447, 9464
USER = 10001
BASE_HOST, ROBOT_HOST = "orograph.io/base", "orograph.io/robots"
"""Labels of nodes: the one that holds the world, and those that hold robots."""
MIB = {"m": 1, "g": 1024}
Manifest = dict[str, Any]


class Wishes:
    """What the manifests are to be for."""

    def __init__(self, robots: int = 3, scenario: str = "tiny", image: str = "orograph", storage: str = "1Gi") -> None:
        self.robots, self.scenario, self.image, self.storage = robots, scenario, image, storage

    def fill(self, text: str) -> str:
        """A string of compose.yaml with its variables filled in."""
        values = {"ROBOTS": str(self.robots), "SCENARIO": self.scenario}
        return re.sub(r"\$\{(\w+):-([^}]*)\}", lambda m: values.get(m[1], m[2]), text).replace("$$", "$")


def manifests(wishes: Wishes) -> list[Manifest]:
    """Everything that `kubectl apply` needs, in order."""
    services = yaml.safe_load((ROOT / "compose.yaml").read_text())["services"]
    routers = [m for plane in keys.PLANES for m in _routers(plane, services[f"router-{plane}"], wishes)]
    workers = [_job(name, services[name], wishes) for name in keys.SERVICES]
    policies = [_closed(), *(_plane(plane) for plane in keys.PLANES), _watched()]
    return [_namespace(), _volume(wishes), *policies, *routers, *workers]


def _meta(name: str, **labels: str) -> Manifest:
    return {"name": name, "namespace": NAMESPACE, "labels": {"app.kubernetes.io/part-of": "orograph", **labels}}


def _namespace() -> Manifest:
    labels = {"pod-security.kubernetes.io/enforce": "restricted"}
    return {"apiVersion": "v1", "kind": "Namespace", "metadata": {"name": NAMESPACE, "labels": labels}}


def _volume(wishes: Wishes) -> Manifest:
    """Every service leaves its part of a run in it, from whatever host."""
    spec = {"accessModes": ["ReadWriteMany"], "resources": {"requests": {"storage": wishes.storage}}}
    return {"apiVersion": "v1", "kind": "PersistentVolumeClaim", "metadata": _meta("runs"), "spec": spec}


# --- who may speak to whom: what compose.yaml's internal networks do -------------------------------------------------


def _policy(name: str, spec: Manifest) -> Manifest:
    return {"apiVersion": "networking.k8s.io/v1", "kind": "NetworkPolicy", "metadata": _meta(name), "spec": spec}


def _closed() -> Manifest:
    """Nobody speaks to anybody; names may be looked up."""
    dns = {
        "to": [{"namespaceSelector": {}, "podSelector": {"matchLabels": {"k8s-app": "kube-dns"}}}],
        "ports": [{"protocol": protocol, "port": 53} for protocol in ("UDP", "TCP")],
    }
    return _policy("closed", {"podSelector": {}, "policyTypes": ["Ingress", "Egress"], "egress": [dns]})


def _plane(plane: str) -> Manifest:
    """A plane's services and routers speak to its routers alone."""
    on_plane, router = {f"orograph.io/{plane}": "true"}, {"orograph.io/router": plane}
    ports = [{"protocol": "TCP", "port": ROUTER_PORT}]
    return _policy(
        f"plane-{plane}",
        {
            "podSelector": {"matchLabels": on_plane},
            "policyTypes": ["Ingress", "Egress"],
            "ingress": [{"from": [{"podSelector": {"matchLabels": on_plane}}], "ports": ports}],
            "egress": [{"to": [{"podSelector": {"matchLabels": router}}], "ports": ports}],
        },
    )


def _watched() -> Manifest:
    """A Prometheus in a namespace with the label orograph.io/watch may read everybody's figures."""
    source = {"namespaceSelector": {"matchLabels": {"orograph.io/watch": "true"}}}
    ingress = [{"from": [source], "ports": [{"protocol": "TCP", "port": METRICS_PORT}]}]
    return _policy("watched", {"podSelector": {}, "policyTypes": ["Ingress"], "ingress": ingress})


# --- routers: one of each plane at the base, one of each plane on every host of robots -------------------------------


def _routers(plane: str, service: Mapping[str, Any], wishes: Wishes) -> list[Manifest]:
    base, far = f"router-{plane}-base", f"router-{plane}"
    link = ("--peer", f"tcp/{base}:{ROUTER_PORT}")
    labels = {f"orograph.io/{plane}": "true", "orograph.io/router": plane}
    at_base = {"replicas": 1, "strategy": {"type": "Recreate"}}
    return [
        _kept("Deployment", base, _pod(base, service, wishes, labels, {BASE_HOST: "true"}), at_base),
        _door(base, {}),
        _kept("DaemonSet", far, _pod(far, service, wishes, labels, {ROBOT_HOST: "true"}, link), {}),
        # A worker's way is always its own host's router.
        _door(far, {"internalTrafficPolicy": "Local"}),
    ]


def _kept(kind: str, name: str, pod: Manifest, more: Manifest) -> Manifest:
    spec = {"selector": {"matchLabels": {"app.kubernetes.io/name": name}}, "template": pod, **more}
    return {"apiVersion": "apps/v1", "kind": kind, "metadata": _meta(name), "spec": spec}


def _door(name: str, more: Manifest) -> Manifest:
    ports = [{"name": "zenoh", "port": ROUTER_PORT, "protocol": "TCP"}]
    spec = {"selector": {"app.kubernetes.io/name": name}, "ports": ports, **more}
    return {"apiVersion": "v1", "kind": "Service", "metadata": _meta(name), "spec": spec}


# --- services: a run has an end, so they are jobs --------------------------------------------------------------------


def _job(name: str, service: Mapping[str, Any], wishes: Wishes) -> Manifest:
    per_robot = name in keys.ROBOT_SERVICES
    labels = {f"orograph.io/{plane}": "true" for plane in service["networks"]}
    host = {ROBOT_HOST if per_robot else BASE_HOST: "true"}
    pod = _pod(name, service, wishes, labels, host)
    never = service["restart"] == "no"
    pod["spec"] |= {"restartPolicy": "Never" if never else "OnFailure"}
    if per_robot:
        pod["spec"]["topologySpreadConstraints"] = [_spread(name)]
    tries = 0 if never else int(service["restart"].partition(":")[2])
    spec = {"parallelism": wishes.robots if per_robot else 1, "backoffLimit": tries, "template": pod}
    return {"apiVersion": "batch/v1", "kind": "Job", "metadata": _meta(name), "spec": spec}


def _spread(name: str) -> Manifest:
    selector = {"matchLabels": {"app.kubernetes.io/name": name}}
    return {
        "maxSkew": 1, "topologyKey": "kubernetes.io/hostname", "whenUnsatisfiable": "ScheduleAnyway",
        "labelSelector": selector,
    }  # fmt: skip


def _pod(
    name: str, service: Mapping[str, Any], wishes: Wishes, labels: Mapping[str, str], host: Mapping[str, str],
    more_arguments: tuple[str, ...] = (),
) -> Manifest:  # fmt: skip
    has_runs = bool(service.get("volumes"))
    volumes: list[Manifest] = [{"name": "tmp", "emptyDir": {"medium": "Memory", "sizeLimit": "64Mi"}}]
    volumes += [{"name": "runs", "persistentVolumeClaim": {"claimName": "runs"}}] if has_runs else []
    spec = {
        "automountServiceAccountToken": False, "enableServiceLinks": False, "terminationGracePeriodSeconds": 4,
        "nodeSelector": dict(host), "volumes": volumes,
        "securityContext": {
            "runAsNonRoot": True, "runAsUser": USER, "runAsGroup": USER, "fsGroup": USER,
            "seccompProfile": {"type": "RuntimeDefault"},
        },
        "containers": [_container(name, service, wishes, has_runs, more_arguments)],
    }  # fmt: skip
    return {"metadata": {"labels": {"app.kubernetes.io/name": name, **labels}}, "spec": spec}


def _container(
    name: str, service: Mapping[str, Any], wishes: Wishes, has_runs: bool, more_arguments: tuple[str, ...]
) -> Manifest:
    router = "router-{}" if name in keys.ROBOT_SERVICES else "router-{}-base"
    endpoints = {
        f"OROGRAPH_{plane.upper()}": f"tcp/{router.format(plane)}:{ROUTER_PORT}" for plane in keys.PLANES if has_runs
    }
    environment = {**service.get("environment", {}), **endpoints}
    mounts = [{"name": "tmp", "mountPath": "/tmp"}]
    mounts += [{"name": "runs", "mountPath": "/run/orograph"}] if has_runs else []
    return {
        "name": name, "image": wishes.image, "args": [*(wishes.fill(a) for a in service["command"]), *more_arguments],
        "env": [{"name": key, "value": value} for key, value in environment.items()],
        "ports": [{"name": "metrics", "containerPort": METRICS_PORT}],
        "readinessProbe": _probe(service["healthcheck"], wishes), "resources": _limits(service["mem_limit"]),
        "securityContext": {
            "allowPrivilegeEscalation": False, "readOnlyRootFilesystem": True, "capabilities": {"drop": ["ALL"]},
        },
        "volumeMounts": mounts,
    }  # fmt: skip


def _probe(healthcheck: Mapping[str, Any], wishes: Wishes) -> Manifest:
    command = ["sh", "-c", wishes.fill(healthcheck["test"][1])]
    seconds = {key: int(healthcheck[key].removesuffix("s")) for key in ("interval", "timeout")}
    return {
        "exec": {"command": command}, "periodSeconds": seconds["interval"], "timeoutSeconds": seconds["timeout"],
        "failureThreshold": healthcheck["retries"],
    }  # fmt: skip


def _limits(memory: str) -> Manifest:
    mebibytes = f"{int(memory[:-1]) * MIB[memory[-1]]}Mi"
    return {"requests": {"memory": mebibytes}, "limits": {"memory": mebibytes}}


def text(wishes: Wishes) -> str:
    """The manifests as one file."""
    head = "# Written by ops/kubernetes/render.py from compose.yaml.\n"
    return head + yaml.safe_dump_all(manifests(wishes), sort_keys=False, width=120)


def main() -> int:
    """Print the manifests."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--robots", type=int, default=3, metavar="N")
    parser.add_argument("--scenario", default="tiny", metavar="NAME")
    parser.add_argument("--image", default="orograph", help="where the hosts find the image")
    parser.add_argument("--storage", default="1Gi", help="room for the runs")
    sys.stdout.write(text(Wishes(**vars(parser.parse_args()))))
    return 0


if __name__ == "__main__":
    sys.exit(main())
