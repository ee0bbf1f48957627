"""What an experiment left: the run folder that every service wrote to, the witness's lines, the nemesis's timeline."""

from __future__ import annotations

import shutil
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from orograph import keys
from orograph.judge.checks import Ledger, read_ledger
from orograph.judge.tracks import tracks
from orograph.launch.machine import commit
from orograph.messages import ROBOT_REGISTER
from orograph.protocol.manager import ManagerSync
from orograph.rules import Rules
from orograph.scenario import Scenario
from orograph.scene.prior import prior_records
from orograph.storage.parts import RunParts, read_parts
from orograph.storage.results import RunInfo, WorldResult
from orograph.storage.run_folder import SCENARIO, STORE, WORLD, read_text
from orograph.storage.sqlite_store import SqliteStore

Line = dict[str, Any]


@dataclass(frozen=True)
class Action:
    """One thing the nemesis did; `heals` when it took a fault away."""

    at: float
    frame: int
    what: str
    heals: bool = False


@dataclass
class Evidence:
    """Plain values, so that the checkers can be tested on made-up ones."""

    parts: RunParts
    ledger: Ledger
    lines: Sequence[Line]
    actions: Sequence[Action] = ()
    stored: np.ndarray = field(default_factory=lambda: np.zeros(0, ROBOT_REGISTER))
    """What the manager's database holds (ROBOT_REGISTER)."""
    recovered: tuple[bytes, bytes] = (b"", b"")
    """Hash of the map after recovering the database, and after recovering it once more."""
    restarted: dict[str, int] = field(default_factory=dict)
    """Robot -> how often its mapping was restarted on purpose."""
    conflicts: int = 0
    healthy: tuple[str, ...] = ()
    """Robots that were not at fault, nor anything that they need."""
    left: frozenset[str] = frozenset()
    """Robots whose mapping was taken away for good; what was acknowledged to them stays."""

    @property
    def staying(self) -> tuple[str, ...]:
        """Robots that were there at the end."""
        return tuple(robot for robot in self.parts.robots if robot not in self.left)

    def of(self, kind: str) -> list[Line]:
        """The witness's lines of one kind, in order."""
        return [line for line in self.lines if line["kind"] == kind]

    @property
    def heal(self) -> Action | None:
        """The last fault's end; None where nothing was done."""
        return max((a for a in self.actions if a.heals), key=lambda a: a.at, default=None)

    def figures(self, node: str) -> list[tuple[float, dict[str, float]]]:
        """(time, figures) of a node, in order."""
        return [(line["at"], line["figures"]) for line in self.of("figures") if line["node"] == node]


def read(folder: Path, lines: Sequence[Line], actions: Sequence[Action]) -> Evidence:
    """The evidence of a fetched run folder; what is missing in it is for the checkers to say."""
    _complete(folder)
    parts = read_parts(folder)
    stored, recovered = _recover(folder, parts)
    return Evidence(parts, read_ledger(parts), lines, actions, stored, recovered)


def _complete(folder: Path) -> None:
    """The orchestrator's part of the folder, which it writes after the run."""
    scenario = Scenario.model_validate_json(read_text(folder, SCENARIO))
    left = (folder / WORLD).exists()
    result = WorldResult.read(folder) if left else WorldResult.of(0, 0.0, None, deterministic=False)
    RunInfo.ran(result, scenario, "chaos", commit()).write(folder)


def _recover(folder: Path, parts: RunParts) -> tuple[np.ndarray, tuple[bytes, bytes]]:
    """Recover a copy of the database as the Map Manager would, twice."""
    robots, prior = parts.robots, prior_records(parts.scenario)
    found: list[tuple[np.ndarray, bytes]] = []
    for attempt in ("once", "twice"):
        copy = folder / f"store-{attempt}"
        copy.mkdir()
        for file in folder.glob(f"{STORE}*"):
            shutil.copy(file, copy / file.name)
        store = SqliteStore(copy / STORE, parts.glrm_grid.shape)
        manager = ManagerSync(parts.glrm_grid.shape, prior, Rules.of(parts.scenario.rules), store, robots)
        found.append((manager.registers(), manager.hash()))
        store.close()
    return found[0][0], (found[0][1], found[1][1])


def settled_s(evidence: Evidence) -> float | None:
    """Seconds from the heal until every robot's copy agreed with a digest of that time; None if one never did.

    Time that a robot then spent in one of the scenario's own radio shadows is taken off.
    """
    heal = evidence.heal
    if heal is None:
        return None
    version = max((f["version"] for at, f in evidence.figures(keys.MANAGER) if at <= heal.at), default=0.0)
    times = [_agreed_at(evidence, robot, heal.at, version) for robot in evidence.staying]
    if None in times:
        return None
    pairs = zip(evidence.staying, times, strict=True)
    return max(at - heal.at - _shadow_s(evidence, robot, heal.at, at) for robot, at in pairs if at is not None)


def _shadow_s(evidence: Evidence, robot: str, begin: float, end: float) -> float:
    """How much of that time the robot was where the scenario has no radio."""
    track, clock = tracks(evidence.parts).get(robot), evidence.figures(keys.WORLD)
    if track is None or not clock:
        return 0.0
    frame_s = evidence.parts.scenario.frame_ns * 1e-9
    stamps_s, walls = [figures["frame"] * frame_s for _, figures in clock], [at for at, _ in clock]
    silent = [np.interp(silence, stamps_s, walls) for silence in track.silences_s()]
    return float(sum(max(0.0, min(b, end) - max(a, begin)) for a, b in silent))


def _agreed_at(evidence: Evidence, robot: str, since: float, version: float) -> float | None:
    before = 0.0
    for at, figures in evidence.figures(keys.node(keys.MAPPING, robot)):
        now = figures.get("copy_digest_matches", 0.0)
        if at > since and now != before and now > 0 and figures["copy_version"] >= version:
            return at
        before = now
    return None


def latencies_s(evidence: Evidence, robots: Sequence[str], during: Callable[[float], bool]) -> list[float]:
    """Time from a cell's first sending to its acknowledgement, of those sent at such times.

    The lesser of simulation and wall time: a lockstep that waits stretches the one, a sender that is itself late on a
    loaded machine the other.
    The scenario's own radio shadows are no fault: what was under way while a robot was in one does not count.
    """
    silences = {robot: track.silences_s() for robot, track in tracks(evidence.parts).items()}
    sent: dict[tuple[str, int, int, int], tuple[int, float]] = {}
    out: list[float] = []
    frame_s = evidence.parts.scenario.frame_ns * 1e-9
    for line in evidence.lines:
        if line["kind"] not in ("Batch", "Ack") or line["robot"] not in robots:
            continue
        for cell, seq in zip(line["cell"], line["seq"], strict=True):
            key = (line["robot"], line["epoch"], cell, seq)
            if line["kind"] == "Batch":
                sent.setdefault(key, (line["frame"], line["at"]))
            elif key in sent and during((begun := sent.pop(key))[1]):
                first_s, last_s = begun[0] * frame_s, line["frame"] * frame_s
                if not any(a <= last_s and first_s <= b for a, b in silences.get(line["robot"], [])):
                    out.append(min(last_s - first_s, line["at"] - begun[1]))
    return out
