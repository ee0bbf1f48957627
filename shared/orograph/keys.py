"""The one builder of Zenoh key expressions, node names and addresses.

A *node* is one step object: `world`, `map-manager`, `laser/robot_001`. A message goes to a node or to a
group (`robot-mapping/*`: that service of every robot). Keys:
`og/<plane>/<to service>/<to robot>/<kind>/<from service>/<from robot>`.
"""

from __future__ import annotations

import re
from functools import lru_cache

SIM, RADIO = "sim", "radio"
PLANES = (SIM, RADIO)
ROOT = "og"

WORLD, LASER, MAPPING, NAVIGATOR, MANAGER, ORCHESTRATOR = (
    "world", "laser", "robot-mapping", "navigator", "map-manager", "orchestrator",
)  # fmt: skip
ROBOT_SERVICES = (LASER, MAPPING, NAVIGATOR)
SERVICES = (WORLD, MANAGER, ORCHESTRATOR, *ROBOT_SERVICES)
RADIO_SERVICES = (MAPPING, NAVIGATOR, MANAGER, ORCHESTRATOR)

NONE, ALL = "-", "all"
EVERY = "*"
"""Stands for the robot in the address of a group."""
ROBOT_ID = re.compile(r"robot_[0-9]{3}")


def robot_id(number: int) -> str:
    """`robot_001` for 1; raises ValueError outside 1..999."""
    if not 1 <= number <= 999:
        raise ValueError(f"robot numbers are 1..999, got {number}")
    return f"robot_{number:03d}"


def robot_number(robot: str) -> int:
    """1 for `robot_001`; raises ValueError for anything that is not a robot id."""
    if not ROBOT_ID.fullmatch(robot):
        raise ValueError(f"not a robot id: {robot!r}")
    return int(robot[-3:])


def node(service: str, robot: str | None = None) -> str:
    """Name of a node: `laser/robot_001`, `world`."""
    assert service in SERVICES, service
    return f"{service}/{robot}" if robot else service


def group(service: str) -> str:
    """Address of that service's nodes of every robot: `robot-mapping/*`."""
    return f"{service}/{EVERY}"


def split(address: str) -> tuple[str, str]:
    """(service, robot) of a node name or group address; robot is '' where there is none."""
    service, _, robot = address.partition("/")
    return service, robot


def message_key(plane: str, to: str, kind: str, sender: str) -> str:
    """Key of one message."""
    to_service, to_robot = split(to)
    from_service, from_robot = split(sender)
    to_chunk = ALL if to_robot == EVERY else (to_robot or NONE)
    return f"{ROOT}/{plane}/{to_service}/{to_chunk}/{kind}/{from_service}/{from_robot or NONE}"


def parse_message_key(key: str) -> tuple[str, str, str, str]:
    """(plane, to, kind, sender) of a key; raises ValueError for any other key."""
    chunks = key.split("/")
    if len(chunks) != 7 or chunks[0] != ROOT or chunks[1] not in PLANES:
        raise ValueError(f"not a message key: {key!r}")
    _, plane, to_service, to_robot, kind, from_service, from_robot = chunks
    if to_service not in SERVICES or from_service not in SERVICES:
        raise ValueError(f"unknown service in key: {key!r}")
    if to_robot not in (NONE, ALL) and not ROBOT_ID.fullmatch(to_robot):
        raise ValueError(f"unknown receiver in key: {key!r}")
    if from_robot != NONE and not ROBOT_ID.fullmatch(from_robot):
        raise ValueError(f"unknown sender in key: {key!r}")
    to = to_service if to_robot == NONE else f"{to_service}/{EVERY if to_robot == ALL else to_robot}"
    sender = from_service if from_robot == NONE else f"{from_service}/{from_robot}"
    return plane, to, kind, sender


def inbox_keys(plane: str, node_name: str) -> list[str]:
    """Key expressions that a node subscribes to on a plane: its own and its group's."""
    service, robot = split(node_name)
    keys = [f"{ROOT}/{plane}/{service}/{robot or NONE}/**"]
    return [*keys, f"{ROOT}/{plane}/{service}/{ALL}/**"] if robot else keys


STREAM = rf"({'|'.join(PLANES)})/[a-z-]+/(-|all|{ROBOT_ID.pattern})/[a-z-]+/(-|{ROBOT_ID.pattern})"
"""Pattern of a stream's name: a message key without its root and kind."""


def stream_name(plane: str, to: str, sender: str) -> str:
    """What a node sends to an address on a plane, as ticks and answers count it: `sim/laser/all/world/-`."""
    to_service, to_robot = split(to)
    from_service, from_robot = split(sender)
    to_chunk = ALL if to_robot == EVERY else (to_robot or NONE)
    return f"{plane}/{to_service}/{to_chunk}/{from_service}/{from_robot or NONE}"


@lru_cache(maxsize=4_096)
def parse_stream_name(name: str) -> tuple[str, str, str]:
    """(plane, to, sender) of a stream's name; raises ValueError for any other."""
    chunks = name.split("/")
    if len(chunks) != 5:
        raise ValueError(f"not a stream's name: {name!r}")
    plane, to, _, sender = parse_message_key("/".join((ROOT, *chunks[:3], "-", *chunks[3:])))
    return plane, to, sender


def alive_key(service: str, instance: str, robots: tuple[str, ...] = ()) -> str:
    """Liveliness token of a service instance, naming the robots it holds (sim plane)."""
    return f"{ROOT}/alive/{service}/{instance}/{'+'.join(robots) or NONE}"


def parse_alive_key(key: str) -> tuple[str, str, tuple[str, ...]]:
    """(service, instance, robots) of a liveliness token; raises ValueError for any other key."""
    chunks = key.split("/")
    if len(chunks) != 5 or chunks[:2] != [ROOT, "alive"]:
        raise ValueError(f"not a liveliness key: {key!r}")
    return chunks[2], chunks[3], () if chunks[4] == NONE else tuple(chunks[4].split("+"))


ALIVE_ALL = f"{ROOT}/alive/**"
"""All liveliness tokens: world and orchestrator listen (sim plane)."""
CLAIM = f"{ROOT}/claim"
"""Query on the sim plane: a replica asks the orchestrator for robots."""
RELEASE = f"{ROOT}/release"
"""`og/release/<instance>`: the orchestrator asks a worker to give its robots back and claim anew (sim plane)."""
BRIEFING = f"{ROOT}/scenario"
"""Query on the sim plane: any service asks what runs; the orchestrator answers, and the world, which outlives it."""
STATUS = f"{ROOT}/status"
"""Query on the radio plane: a person asks the orchestrator how the cluster stands."""
REVOKE = f"{ROOT}/revoke"
"""Query on the radio plane: a person asks the map manager to be without a robot for good."""
TICK = f"{ROOT}/tick"
"""World's clock, every participant listens (sim plane)."""
DONE = f"{ROOT}/done"
"""`og/done/<instance>`: a participant's answer to a tick, or its wish to join (sim plane)."""
TELEMETRY = f"{ROOT}/telemetry"
"""`og/telemetry/<service>/<robot>`: figures for people, never read by a node (sim plane)."""

CALLBACKS = ("message", "alive", "claim", "done", "release", "revoke", "scenario", "status", "telemetry", "tick")
"""What a process hears or is asked, by the word by which failures to take it are counted."""


def callback_kind(key: str) -> str:
    """The one of CALLBACKS under which a key falls."""
    plane_or_kind = key.split("/")[1]
    return "message" if plane_or_kind in PLANES else plane_or_kind


def done_key(instance: str) -> str:
    """Key of a participant's answers."""
    return f"{DONE}/{instance}"


def release_key(instance: str) -> str:
    """Key on which a worker is asked to claim anew."""
    return f"{RELEASE}/{instance}"


def telemetry_key(node_name: str) -> str:
    """Key of a node's figures."""
    service, robot = split(node_name)
    return f"{TELEMETRY}/{service}/{robot or NONE}"


def parse_telemetry_key(key: str) -> str:
    """The node whose figures they are; raises ValueError for any other key."""
    chunks = key.split("/")
    known = len(chunks) == 4 and chunks[:2] == TELEMETRY.split("/") and chunks[2] in SERVICES
    if not known or not (chunks[3] == NONE or ROBOT_ID.fullmatch(chunks[3])):
        raise ValueError(f"not a key of figures: {key!r}")
    return chunks[2] if chunks[3] == NONE else f"{chunks[2]}/{chunks[3]}"
