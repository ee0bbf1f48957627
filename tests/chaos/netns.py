"""Faults below TCP in a container's own network namespace, with whatever tool the host's kernel has."""

from __future__ import annotations

import json
import subprocess
from collections.abc import Iterator, Sequence
from contextlib import contextmanager

from chaos.cluster import ChaosError, call

TABLE = "orograph_chaos"


def address(container: str, network: str) -> str:
    """A container's IPv4 address on one network."""
    networks = json.loads(call("docker", "inspect", "--format", "{{json .NetworkSettings.Networks}}", container))
    return str(networks[network]["IPAddress"])


def _pid(container: str) -> str:
    return call("docker", "inspect", "--format", "{{.State.Pid}}", container).strip()


def _enter(pid: str, *command: str, stdin: str = "") -> tuple[bool, str]:
    done = subprocess.run(
        ["nsenter", "--target", pid, "--net", "--", *command], input=stdin, text=True,
        stdout=subprocess.PIPE, stderr=subprocess.STDOUT,
    )  # fmt: skip
    return done.returncode == 0, done.stdout.strip()


def _rules(router: str, percent: int, directions: Sequence[str]) -> str:
    chance = "" if percent >= 100 else f"numgen random mod 100 < {percent} "
    chains = {"up": ("output", f"ip daddr {router}"), "down": ("input", f"ip saddr {router}")}
    lines = []
    for direction in directions:
        hook, match = chains[direction]
        lines.append(
            f"chain {hook} {{ type filter hook {hook} priority 0; policy accept; {match} {chance}counter drop; }}"
        )
    return "\n".join([f"table inet {TABLE} {{", *lines, "}", ""])


def _by_iptables(pid: str, router: str, percent: int, directions: Sequence[str], verb: str) -> tuple[bool, str]:
    chance = [] if percent >= 100 else ["-m", "statistic", "--mode", "random", "--probability", f"{percent / 100}"]
    ends = {"up": ("OUTPUT", "-d"), "down": ("INPUT", "-s")}
    ok, said = True, ""
    for direction in directions:
        chain, side = ends[direction]
        ok, said = _enter(pid, "iptables", verb, chain, side, router, *chance, "-j", "DROP")
        if not ok:
            break
    return ok, said


@contextmanager
def dropping(containers: Sequence[str], router: str, percent: int, directions: Sequence[str]) -> Iterator[str]:
    """Drop packets between the containers and the router; gives the tool that does it.

    Raises ChaosError where there is none.
    """
    pids = [_pid(container) for container in containers]
    ok, said = _enter(pids[0], "nft", "--check", "--file", "-", stdin=_rules(router, percent, directions))
    tool = "nft" if ok else "iptables"
    try:
        for pid in pids:
            if tool == "nft":
                done, why = _enter(pid, "nft", "--file", "-", stdin=_rules(router, percent, directions))
            else:
                done, why = _by_iptables(pid, router, percent, directions, "-A")
            if not done:
                raise ChaosError(f"neither nft ({said}) nor iptables ({why}) can drop packets here")
        yield tool
    finally:
        for pid in pids:
            if tool == "nft":
                _enter(pid, "nft", "delete", "table", "inet", TABLE)
            else:
                _by_iptables(pid, router, percent, directions, "-D")
