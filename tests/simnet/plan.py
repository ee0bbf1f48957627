"""What goes wrong in a storm, drawn from its seed alone: a value to print, to compare and to cut down."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from typing import NamedTuple

import numpy as np
from orograph import keys
from orograph.runtime.network import CUT, Spell, Weather

SCAN_FRAMES = 38
"""Robots drive and scan so long; then they say that they are done, and the flush begins while the storm goes on."""
STORM_FRAMES = 50
CHANCES = [0, 0.1, 0.3, 0.5]


class Fault(NamedTuple):
    """What happens to one node from a frame on, for so many frames; `of` numbers the lives of a name."""

    name: str
    begin: int
    frames: int


class LostDisk(NamedTuple):
    """The manager ends and comes back with what its disk held at an earlier frame; with nothing, at frame 0."""

    begin: int
    copied: int


@dataclass(frozen=True)
class Plan:
    """One storm; without its faults it is the run that nothing disturbs, over the same scans."""

    seed: int
    robots: tuple[str, ...]
    forecast: tuple[Spell, ...] = ()
    deaths: tuple[Fault, ...] = ()
    """A process is lost with its memory; frames until the next one starts."""
    hangs: tuple[Fault, ...] = ()
    """A process stands still, then takes all that came meanwhile."""
    full_disk: tuple[tuple[int, int], ...] = ()
    """(begin, end) in frames."""
    failed_syncs: tuple[tuple[int, str], ...] = ()
    """(frame, "lost" or "kept"): of the next commit."""
    twins: tuple[Fault, ...] = ()
    """A second container with the id of a robot."""
    lost_disks: tuple[LostDisk, ...] = ()
    revocations: tuple[tuple[int, str], ...] = ()
    """(frame, robot): from then on a person asks the manager to be without it, until that is confirmed."""
    meddled: bool = False
    """Radio messages are recorded and sent again, spoiled batches sent, and words forged in the manager's name."""

    @property
    def every_scan_counts(self) -> bool:
        """Whether all robots keep their memory and hear no flush with their last scans: then the map is promised."""
        lost = [death for death in self.deaths if keys.split(death.name)[0] == keys.MAPPING]
        late = [hang for hang in self.hangs if hang.begin <= SCAN_FRAMES < hang.begin + hang.frames]
        return not (self.twins or lost or any(keys.split(hang.name)[0] == keys.MAPPING for hang in late))

    def keeps(self, name: str) -> bool:
        """Whether a robot, or that of a node, is not to be revoked."""
        return not any(name.endswith(robot) for _, robot in self.revocations)

    def without_one(self) -> list[Plan]:
        """This plan with one of its faults left out, for each."""
        out = [replace(self, meddled=False)] if self.meddled else []
        for field in fields(self)[2:-1]:
            faults = getattr(self, field.name)
            out += [replace(self, **{field.name: (*faults[:i], *faults[i + 1 :])}) for i in range(len(faults))]
        return out


def plan_of(seed: int) -> Plan:
    """Every third seed keeps the robots' memory, so that invariant 11 is judged; every seventh has a twin.

    In every fifth the manager loses its disk, without a twin: what one of two has put over the other's is then lost.
    In every fourth without either a robot is revoked.
    """
    rng = np.random.default_rng([seed, 1])
    robots = tuple(keys.robot_id(i + 1) for i in range(2 + (seed % 4 == 1)))
    loses_disk = seed % 5 == 4
    keeps_memory, twin = seed % 3 == 0, seed % 3 != 0 and seed % 7 == 0 and not loses_disk
    deaths = [*_faults(rng, keys.MANAGER, 0.025, 10), *_faults(rng, keys.ORCHESTRATOR, 0.008, 10)]
    hangs = _faults(rng, keys.MANAGER, 0.008, 20)
    twins = []
    for robot in robots:
        name = keys.node(keys.MAPPING, robot)
        deaths += [] if keeps_memory else _faults(rng, name, 0.03 / len(robots), 6)
        hangs += _faults(rng, name, 0.015 / len(robots), 20)
    if twin:
        twins.append(Fault(keys.node(keys.MAPPING, str(rng.choice(robots))), STORM_FRAMES // 3, STORM_FRAMES))
    return Plan(
        seed, robots, (*_weathers(rng), *_cuts(rng, robots)), tuple(deaths), tuple(hangs), _full_disk(rng),
        _failed_syncs(rng), tuple(twins), _lost_disk(rng) if loses_disk else (),
        _revocation(seed, robots) if seed % 4 == 2 and not (twins or loses_disk) else (), meddled=True,
    )  # fmt: skip


def _frames(rng: np.random.Generator, chance: float) -> list[int]:
    return np.flatnonzero(rng.random(STORM_FRAMES) < chance).tolist()


def _faults(rng: np.random.Generator, name: str, chance: float, frames_max: int) -> list[Fault]:
    return [Fault(name, begin, int(rng.integers(0, frames_max))) for begin in _frames(rng, chance)]


def _weathers(rng: np.random.Generator) -> list[Spell]:
    begins = [0, *_frames(rng, 0.12)]
    spells = []
    for begin, end in zip(begins, [*begins[1:], STORM_FRAMES], strict=True):
        loss, doubled, late, overtaking = rng.choice(CHANCES, 4).tolist()
        weather = Weather(loss, doubled, late, int(rng.integers(1, 26)), overtaking)
        spells.append(Spell(weather, begin, end))
    return [spell for spell in spells if spell.begin < spell.end]


def _cuts(rng: np.random.Generator, robots: tuple[str, ...]) -> list[Spell]:
    """Of one robot's link, one or both directions; now and then of the whole base station."""
    cuts = []
    for begin in _frames(rng, 0.06):
        end = min(STORM_FRAMES, begin + 1 + int(rng.integers(0, 30)))
        whose = () if rng.random() < 0.1 else (str(rng.choice(robots)),)
        up, down = [(True, True), (True, False), (False, True)][int(rng.integers(3))]
        cuts.append(Spell(CUT, begin, end, whose, up, down))
    return cuts


def _full_disk(rng: np.random.Generator) -> tuple[tuple[int, int], ...]:
    return tuple((begin, min(STORM_FRAMES, begin + int(rng.integers(1, 9)))) for begin in _frames(rng, 0.025))


def _failed_syncs(rng: np.random.Generator) -> tuple[tuple[int, str], ...]:
    return tuple((begin, str(rng.choice(["lost", "kept"]))) for begin in _frames(rng, 0.04))


def _lost_disk(rng: np.random.Generator) -> tuple[LostDisk, ...]:
    begin = int(rng.integers(STORM_FRAMES // 3, STORM_FRAMES))
    return (LostDisk(begin, int(rng.choice([0, begin // 2]))),)


def _revocation(seed: int, robots: tuple[str, ...]) -> tuple[tuple[int, str], ...]:
    rng = np.random.default_rng([seed, 5])
    return ((int(rng.integers(5, STORM_FRAMES)), str(rng.choice(robots))),)
