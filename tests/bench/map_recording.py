"""Scans, estimated poses and true bodies of a whole mission, recorded once and kept in the machine's cache.

The mission is an ordinary one in this process; taps beside its nodes copy what they are sent, so nothing of it changes.
"""

from __future__ import annotations

import hashlib
import tempfile
import zipfile
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
from orograph import keys
from orograph.launch.in_process import build_rounds
from orograph.launch.machine import commit
from orograph.messages import POSE, Bodies, Envelope, Frame, Phase, Pose, Scan
from orograph.node import Node, Note, Send
from orograph.nodes.robot_mapping import POSE_WAIT_FRAMES, ScanPoseSync
from orograph.nodes.world import WorldNode
from orograph.protocol.tiles import map_hash
from orograph.runtime.rounds import Rounds
from orograph.scenario import Scenario
from orograph.storage.recording import Recording
from orograph.storage.run_folder import STORE, write_arrays
from orograph.storage.sqlite_store import SqliteStore

VERSION = "1"
"""Grows with the form of what is kept, and with any change of world or laser that a score must see."""
POSE_FIELDS = ("x_m", "y_m", "z_m", "roll_rad", "pitch_rad", "yaw_rad")
SCAN = np.dtype([("stamp_ns", "<i8"), ("robot", "<u2"), *((name, "<f8") for name in POSE_FIELDS)])
"""A scan's robot (by number) and the pose that its navigator believed."""


@dataclass(frozen=True, eq=False)
class Mission:
    """All scans that were mapped, in the order of time and robot, and where everything truly was."""

    scans: npt.NDArray[Any]
    """(n,) SCAN."""
    ranges: npt.NDArray[np.uint16]
    """(n, rings, columns) in RANGE_UNIT_M, 0 = no return."""
    bodies: npt.NDArray[Any]
    """(n, robots + vehicles) POSE at each scan's stamp."""
    glrm_hash: str
    """Of the Map Manager's map at the end: the scenario's own rules over the same scans must give it again."""
    commit: str


def recorded(scenario: Scenario, cache: Path, progress: Callable[[float], None]) -> Mission:
    """The mission of a scenario, from the cache where it has been made before; `progress` hears simulated seconds."""
    told = VERSION + scenario.model_dump_json(exclude_defaults=True)
    name = hashlib.blake2b(told.encode(), digest_size=16).hexdigest()
    kept = cache / f"mission-{scenario.name}-{scenario.seed}-{name}.npz"
    try:
        with np.load(kept, allow_pickle=False) as arrays:
            scans, ranges, bodies, glrm_hash, commit_then = (arrays[f.name] for f in fields(Mission))
            return Mission(scans, ranges, bodies, str(glrm_hash), str(commit_then))
    except (FileNotFoundError, zipfile.BadZipFile):
        mission = record(scenario, progress)
    write_arrays(kept, {f.name: np.asarray(getattr(mission, f.name)) for f in fields(Mission)})
    return mission


def record(scenario: Scenario, progress: Callable[[float], None]) -> Mission:
    """Run the mission to its end."""
    with tempfile.TemporaryDirectory() as folder, Recording(Path(folder), "in-process") as recording:
        rounds = build_rounds(scenario, SqliteStore(Path(folder) / STORE, scenario.grid.grid.shape), recording, {})
        world = next(n for n in rounds.nodes if isinstance(n, WorldNode))
        taps = _tap(rounds, scenario)
        while world.ended is None:
            rounds.step()
            progress(rounds.stamp_ns * 1e-9)
        manager = next(n for n in rounds.nodes if n.name == keys.MANAGER)
        return _mission(taps, map_hash(manager.artifacts()["glrm"]).hex())


class MappingTap:
    """Stands for a robot's mapping node and keeps the scans that it maps, with their poses."""

    def __init__(self, node: Node, wait_ns: int) -> None:
        self.name, self._node, self._pairs, self._flushing = node.name, node, ScanPoseSync(wait_ns), False
        self.scans: list[tuple[Scan, Pose]] = []

    def step(self, frame: Frame, inbox: Sequence[Envelope], send: Send, note: Note) -> None:
        """Copy, then let the node step."""
        for envelope in inbox:
            if isinstance(envelope.message, Scan | Pose):
                self._pairs.take(envelope.message)
            elif isinstance(envelope.message, Phase):
                self._flushing |= envelope.message.name != "mapping"
        pairs = self._pairs.pairs(frame.stamp_ns)
        self.scans += [] if self._flushing else pairs
        self._node.step(frame, inbox, send, note)

    def telemetry(self) -> Mapping[str, float]:
        """The node's."""
        return self._node.telemetry()

    def artifacts(self) -> Mapping[str, npt.NDArray[Any]]:
        """The node's."""
        return self._node.artifacts()


class LaserTap:
    """Stands for a laser node and keeps where the world said that everything was."""

    def __init__(self, node: Node) -> None:
        self.name, self._node = node.name, node
        self.bodies: dict[int, npt.NDArray[Any]] = {}

    def step(self, frame: Frame, inbox: Sequence[Envelope], send: Send, note: Note) -> None:
        """Copy, then let the node step."""
        for envelope in inbox:
            if isinstance(envelope.message, Bodies):
                self.bodies[envelope.message.stamp_ns] = envelope.message.poses
        self._node.step(frame, inbox, send, note)

    def telemetry(self) -> Mapping[str, float]:
        """The node's."""
        return self._node.telemetry()

    def artifacts(self) -> Mapping[str, npt.NDArray[Any]]:
        """The node's."""
        return self._node.artifacts()


def _tap(rounds: Rounds, scenario: Scenario) -> list[MappingTap | LaserTap]:
    taps: list[MappingTap | LaserTap] = []
    for i, node in enumerate(rounds.nodes):
        service = keys.split(node.name)[0]
        if service == keys.MAPPING:
            taps.append(MappingTap(node, POSE_WAIT_FRAMES * scenario.frame_ns))
        elif service == keys.LASER:
            taps.append(LaserTap(node))
        else:
            continue
        rounds.nodes[i] = taps[-1]
    return taps


def _mission(taps: Sequence[MappingTap | LaserTap], glrm_hash: str) -> Mission:
    bodies = next(tap.bodies for tap in taps if isinstance(tap, LaserTap))
    scans = [
        (pose, keys.robot_number(keys.split(tap.name)[1]), scan)
        for tap in taps if isinstance(tap, MappingTap) for scan, pose in tap.scans
    ]  # fmt: skip
    scans.sort(key=lambda s: (s[2].stamp_ns, s[1]))
    rows = np.zeros(len(scans), SCAN)
    for row, (pose, robot, scan) in zip(rows, scans, strict=True):
        row["stamp_ns"], row["robot"] = scan.stamp_ns, robot
        for name in POSE_FIELDS:
            row[name] = getattr(pose, name)
    ranges = np.array([scan.ranges for _, _, scan in scans])
    at = np.array([bodies[scan.stamp_ns] for _, _, scan in scans], POSE)
    return Mission(rows, ranges, at, glrm_hash, commit())
