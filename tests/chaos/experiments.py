"""The table of experiments: what runs, what breaks it, what must turn red."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from chaos import nemeses as n
from orograph import keys

RUN_FOLDER = "/run/orograph/tiny-001"
SMALL_DISK = {
    "services": {
        keys.MANAGER: {"volumes": ["disk:/run/orograph"]},
        # Holds the volume, which lives in memory, when the manager has ended.
        "witness": {"volumes": ["disk:/disk:ro"]},
    },
    "volumes": {
        "disk": {"driver_opts": {"type": "tmpfs", "device": "tmpfs", "o": "size=4m,uid=10001,gid=10001,mode=0755"}}
    },
}
PROXY = {
    "services": {
        "radio-proxy": {
            "image": "orograph", "command": ["python", "/chaos/proxy.py"], "user": "10001:10001", "read_only": True,
            "tmpfs": ["/tmp:size=8m,mode=1777"], "cap_drop": ["ALL"], "init": True, "networks": ["radio"],
            "security_opt": ["no-new-privileges:true"], "volumes": ["${CHAOS_DIR}:/chaos:ro"],
            "depends_on": {"router-radio": {"condition": "service_healthy"}},
        },
        **{
            service: {
                "environment": {"OROGRAPH_RADIO": "tcp/radio-proxy:7447"},
                "depends_on": {"radio-proxy": {"condition": "service_started"}},
            }
            for service in (keys.MAPPING, keys.NAVIGATOR)
        },
    }
}  # fmt: skip


def mutant(service: str, file: str) -> Mapping[str, Any]:
    """The service started from a broken entry point under tests/chaos/mutants."""
    line = ["python", f"/chaos/mutants/{file}", "--ready-file", "/tmp/ready"]
    return {"services": {service: {"command": line, "volumes": ["${CHAOS_DIR}:/chaos:ro"]}}}


@dataclass(frozen=True)
class Experiment:
    """One mission with one nemesis; of a mutant, `caught_by` are the invariants of which one must say so."""

    name: str
    what: str
    nemesis: n.Nemesis
    wishes: Mapping[str, str] = field(default_factory=dict)
    overlay: Mapping[str, Any] = field(default_factory=dict)
    healthy: tuple[str, ...] = ()
    caught_by: tuple[str, ...] = ()


OTHER = ("robot_002",)
PACED = {"TIME_SCALE": "1.5"}
"""Where a fault has to last for seconds of the mission as well, and lockstep would run past it."""

SLOW = {"TIME_SCALE": "0.75"}
"""Where a service has to start again: a mission is no longer than its robots wait, and Python starts slowly."""

EXPERIMENTS = (
    Experiment("F0", "no fault", n.nothing, healthy=("robot_001", "robot_002")),
    Experiment("F1", "robot's radio cut 5 s", n.radio_cut(5.0), healthy=OTHER),
    Experiment("F1b", "robot's radio cut 30 s", n.radio_cut(30.0), PACED, healthy=OTHER),
    Experiment("F2", "radio router away 10 s", n.router_down(10.0)),
    Experiment("F3", "one direction dropped 8 s, then the other",
               n.one_after_the_other(n.one_direction("up", 8.0), n.one_direction("down", 8.0)), PACED, healthy=OTHER),
    Experiment("F4", "20 % packet loss 15 s", n.packet_loss(20, 15.0), PACED, healthy=OTHER),
    Experiment("F5", "256 kbit/s 10 s, then 500 ms +-200 10 s",
               n.one_after_the_other(n.proxied("rate 32000", 10.0), n.proxied("delay 500 200", 10.0)), PACED, PROXY),
    Experiment("F7", "connections reset every second 10 s", n.proxied("reset 1", 10.0), PACED, PROXY),
    Experiment("F8", "radio router killed", n.router_down(0.5)),
    Experiment("F9", "manager kill -9 three times", n.manager_killed(), SLOW),
    Experiment("F12", "manager's disk full 10 s", n.disk_full(RUN_FOLDER, 10.0), PACED, SMALL_DISK),
    Experiment("F13", "robot-mapping kill -9 twice", n.mapping_killed(), SLOW, healthy=OTHER),
    Experiment("F14", "manager and a robot paused 15 s", n.paused((keys.MANAGER, keys.MAPPING), 15.0), PACED),
    Experiment("F16", "robot-mapping out of memory", n.out_of_memory, SLOW, healthy=OTHER),
    Experiment("F18", "scaled 1 -> 10 -> 3", n.scaled((1, 10, 3)),
               {**SLOW, "ROBOTS": "10", "START_WITH": "1"}),
    Experiment("F19", "second worker with the same id", n.second_worker, SLOW, healthy=("robot_001", "robot_002")),
    Experiment("F22", "rolling restart of all but world", n.rolling_restart, SLOW),
    Experiment("F23", "laser paused 6 s, then world 6 s",
               n.one_after_the_other(n.paused((keys.LASER,), 6.0), n.paused((keys.WORLD,), 6.0, 200))),
    Experiment("F24", "orchestrator kill -9", n.orchestrator_killed, SLOW, healthy=("robot_001", "robot_002")),
    Experiment("F27a", "storm, seed 1", n.storm, {**SLOW, "SEED": "1"}),
    Experiment("F27b", "storm, seed 2", n.storm, {**SLOW, "SEED": "2"}),
    Experiment("F27c", "storm, seed 3", n.storm, {**SLOW, "SEED": "3"}),
    # A robot may offer its cells again before anyone misses them; that the versions went back stays to be seen.
    Experiment("M1", "MUTANT: acknowledges before it commits", n.manager_killed((200,)), SLOW,
               overlay=mutant(keys.MANAGER, "late_store.py"), caught_by=("1", "4")),
    Experiment("M2", "MUTANT: forgets unsent cells on reconnect", n.router_down(8.0, 300), PACED,
               overlay=mutant(keys.MAPPING, "forgetful.py"), caught_by=("3",)),
)  # fmt: skip


def chosen(only: str) -> list[Experiment]:
    """Those named in a comma-separated list (F27 means F27a, F27b, ...), all for an empty one; raises ValueError."""
    wanted = [word.strip() for word in only.split(",") if word.strip()]
    found = [e for e in EXPERIMENTS if not wanted or e.name in wanted or e.name.rstrip("abc") in wanted]
    names = {e.name for e in EXPERIMENTS} | {e.name.rstrip("abc") for e in EXPERIMENTS}
    if unknown := [word for word in wanted if word not in names]:
        raise ValueError(f"no such experiment: {', '.join(unknown)} (there are {', '.join(sorted(names))})")
    return found
