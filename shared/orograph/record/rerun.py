"""What the robots sent up, fed to a Map Manager that knows nothing: it must come to the same map."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import groupby

from orograph import keys
from orograph.messages import Delta, Digest, ManagerStatus, Message, Welcome
from orograph.protocol.manager import ManagerSync
from orograph.protocol.store import MemoryStore
from orograph.record.reading import Record, Told
from orograph.rules import Rules
from orograph.scene.site import Site


@dataclass(frozen=True)
class Rerun:
    """What came out, beside what the recorded manager said of its own map last."""

    messages: int
    reached_hash: str
    recorded_hash: str

    @property
    def agrees(self) -> bool:
        """Whether it is the same map."""
        return self.reached_hash == self.recorded_hash


def rerun(records: Sequence[Record]) -> Rerun:
    """Feed the uplink of a run's records to a fresh manager, which lives as often as the recorded one did.

    It hears what was sent in a radio shadow too, which the recorded one had to be sent again; the fold of each
    robot's newest registers is the same.
    """
    scenario = records[0].scenario
    told = [t for record in records for t in record.told]
    site, store = Site(scenario), MemoryStore()
    manager = _manager(site, store, 0)
    begins, up = lives(told), [t for t in told if t.to == keys.MANAGER]
    for stamp_ns, frame in groupby(up, key=lambda t: t.stamp_ns):
        while begins and begins[0][0] <= stamp_ns:
            manager = _manager(site, store, begins.pop(0)[1])
        manager.step(stamp_ns + scenario.frame_ns, [_heard(t) for t in frame], _unsent)
    last = next((t.message for t in reversed(told) if isinstance(t.message, ManagerStatus)), None)
    for number in last.revoked.tolist() if last else ():
        manager.revoke(keys.robot_id(number))
    manager.step(told[-1].stamp_ns + 2 * scenario.frame_ns if told else 0, [], _unsent)
    return Rerun(len(up), manager.hash().hex(), last.glrm_hash.hex() if last else "")


def lives(told: Sequence[Told]) -> list[tuple[int, int]]:
    """(stamp from which it heard, manager epoch) of each life of the manager: one ends with the last it said."""
    ends: dict[int, int] = {}
    for t in told:
        if t.sender == keys.MANAGER and isinstance(t.message, Welcome | Delta | Digest):
            ends[t.message.manager_epoch] = t.stamp_ns
    return list(zip([0, *(end + 1 for end in ends.values())], ends, strict=False))


def _manager(site: Site, store: MemoryStore, manager_epoch: int) -> ManagerSync:
    scenario, held = site.scenario, store.load().manager_epoch
    return ManagerSync(
        scenario.grid.grid.shape, site.prior, Rules.of(scenario.rules), store, scenario.robot_ids,
        draw=max(manager_epoch - 1 - held, 0),
    )  # fmt: skip


def _heard(told: Told) -> tuple[str, Message]:
    return keys.split(told.sender)[1], told.message


def _unsent(robot: str | None, message: Message) -> None:
    """Nobody hears the manager of a rerun."""
