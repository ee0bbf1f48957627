"""One seeded storm over the real nodes: robots scan and map while the network and the machines fail.

Everything follows from the seed: the plan of faults, every message's fate, every scan. A storm is: faults while the
robots drive and while they begin to flush, then heal, then the end that the orchestrator declares.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from functools import partial

import numpy as np
from orograph import keys
from orograph.control import Revoke
from orograph.messages import (
    ACKED,
    CELL,
    ROBOT_REGISTER,
    U4,
    UPDATE,
    Ack,
    Batch,
    Delta,
    Digest,
    Envelope,
    Fenced,
    Frame,
    Hello,
    Message,
    RunEnd,
)  # fmt: skip
from orograph.nodes.map_manager import MapManagerNode
from orograph.nodes.orchestrator import OrchestratorNode
from orograph.nodes.robot_mapping import RobotMappingNode
from orograph.protocol.copy import GlrmCopy
from orograph.protocol.fold import fold_registers, same_values
from orograph.protocol.joining import EPOCH_STEP_MAX
from orograph.protocol.manager import ManagerSync
from orograph.protocol.robot import RobotSync
from orograph.protocol.store import StoredState
from orograph.protocol.tiles import Tiles, map_hash
from orograph.runtime.network import Network
from orograph.runtime.rounds import Rounds
from orograph.scene.site import Site
from simnet.history import Acked, Commit, History, Load, Sighting
from simnet.machine import Machine, Sent, WatchedStore
from simnet.plan import SCAN_FRAMES, STORM_FRAMES, Fault, LostDisk, Plan, plan_of
from simnet.street import PRIOR, RULES, SCENARIO, SIZE, SMALL, Laser, Navigator, mapped_alone, street_of

END_WITHIN_FRAMES = 400
OVERHEARD_MAX = 400
SILENCE_FRAMES = 15


@dataclass(frozen=True)
class Cast:
    """Whose code runs; a mutant takes the place of one of these."""

    mapping: type[RobotMappingNode] = RobotMappingNode
    manager: type[MapManagerNode] = MapManagerNode
    orchestrator: type[OrchestratorNode] = OrchestratorNode
    robot_sync: type[RobotSync] = RobotSync
    manager_sync: type[ManagerSync] = ManagerSync

    @classmethod
    def with_mutant(cls, mutant: type) -> Cast:
        """The one whose subclass it is gives its place to it."""
        return cls(**{f.name: mutant for f in fields(cls) if issubclass(mutant, getattr(cls, f.name))})


ALL_REAL = Cast()


class Storm:
    """State of one run; `run` plays it to the end."""

    def __init__(self, plan: Plan, cast: Cast) -> None:
        self._plan, self._cast, self.history = plan, cast, History(plan.seed, PRIOR)
        self._scenario = street_of(plan.seed, len(plan.robots))
        self._site = Site(self._scenario)
        self._rng, self._draws = np.random.default_rng([plan.seed, 2]), np.random.default_rng([plan.seed, 4])
        self._store = WatchedStore(self._committed)
        self._copies: dict[int, StoredState] = {}
        """What the disk held at a frame."""
        self._misled: set[str] = set()
        self._manager_epochs: set[int] = set()
        """Of the managers that had the present store."""
        self._overheard: list[Envelope] = []
        self._lives, self._silent_since = 0, dict[str, int]()
        self._manager = Machine(keys.MANAGER, self._new_manager, self._manager_stepped)
        self._orchestrator = Machine(keys.ORCHESTRATOR, self._new_orchestrator, lambda *step: None)
        self._mappings = [self._mapping(robot) for robot in plan.robots]
        self._mappings += [self._mapping(keys.split(twin.name)[1], twin) for twin in plan.twins]
        self._scans_until = SCAN_FRAMES if plan.every_scan_counts else STORM_FRAMES + END_WITHIN_FRAMES
        lasers = [Laser(plan.seed, robot, self._scans_until) for robot in plan.robots]
        navigators = [Navigator(plan.seed, robot, SCAN_FRAMES) for robot in plan.robots]
        nodes = [self._manager, self._orchestrator, *self._mappings, *lasers, *navigators]
        names = {keys.WORLD, *(node.name for node in nodes)}
        self.network = Network(self._scenario, sorted(names), dict, plan.forecast)
        self._rounds = Rounds(self._scenario.frame_ns, nodes, self.network, lambda *note: None)

    # --- machines ----------------------------------------------------------------------------------------------------

    def _mapping(self, robot: str, twin: Fault | None = None) -> Machine:
        machine = Machine(
            keys.node(keys.MAPPING, robot), partial(self._new_mapping, robot),
            lambda *step: self._mapping_stepped(machine, *step), twin.begin if twin else 0,
        )  # fmt: skip
        return machine

    def _new_mapping(self, robot: str) -> RobotMappingNode:
        self._lives += 1
        nonce = self._plan.seed.to_bytes(8, "little") + self._lives.to_bytes(8, "little")
        node = self._cast.mapping(self._site, robot, self._plan.seed, nonce, limits=SMALL)
        if self._cast.robot_sync is not RobotSync:
            node._sync = self._cast.robot_sync(robot, SCENARIO.grid.grid.shape, PRIOR, nonce, self._plan.seed, SMALL)
        return node

    def _new_manager(self) -> MapManagerNode:
        """Recovered from the store, and once more to see that this is repeatable."""
        node = self._manager_node()
        if self._manager.lives:
            self.history.recovered.append((node._sync.hash(), self._manager_node()._sync.hash()))
        return node

    def _manager_node(self) -> MapManagerNode:
        given = {"limits": SMALL, "draw": int(self._draws.integers(2**31))}
        node = self._cast.manager(self._site, self._plan.robots, self._store, **given)
        if self._cast.manager_sync is not ManagerSync:
            shape = SCENARIO.grid.grid.shape
            node._sync = self._cast.manager_sync(shape, PRIOR, RULES, self._store, self._plan.robots, **given)
        self._manager_epochs.add(node._sync.manager_epoch)
        return node

    def _new_orchestrator(self) -> OrchestratorNode:
        return self._cast.orchestrator(self._site, self._plan.robots, self._plan.seed)

    def _break(self, frame: int) -> None:
        """What the plan has for this frame."""
        machines = [self._manager, self._orchestrator, *self._mappings]
        for faults, strike in ((self._plan.deaths, Machine.kill), (self._plan.hangs, Machine.hang)):
            for fault in (fault for fault in faults if fault.begin == frame):
                strike(next(m for m in machines if m.name == fault.name), frame, fault.frames)
        self._copies[frame] = self._store.load()
        for lost in self._plan.lost_disks:
            if lost.begin == frame:
                self._lose_disk(lost)
        for begin, outcome in self._plan.failed_syncs:
            self._store.fail_next = outcome if begin == frame else self._store.fail_next
        self._store.full = any(begin <= frame < end for begin, end in self._plan.full_disk)

    def _ask_for_revocations(self, frame: int) -> None:
        """A person asks until the manager says that it is done, and never again."""
        manager = self._manager.node
        if not isinstance(manager, MapManagerNode):
            return
        for begin, robot in self._plan.revocations:
            if frame >= begin and keys.robot_number(robot) not in self.history.revoked:
                if robot in manager.revoked:
                    self.history.revoked += (keys.robot_number(robot),)
                else:
                    manager.take_revoke(Revoke(robot))

    def _lose_disk(self, lost: LostDisk) -> None:
        """From here on the new store is judged; what the old one acknowledged only the robots still have."""
        self._manager.kill(lost.begin, 5)
        self._store = WatchedStore(self._committed, self._copies[lost.copied])
        self._manager_epochs.clear()
        self.history.lost_disks += 1
        for judged in (self.history.acked, self.history.commits, self.history.sightings):
            judged.clear()

    def _heal(self) -> None:
        self._store.fail_next, self._store.full = None, False
        for machine in (self._manager, self._orchestrator, *self._mappings):
            machine.mend()

    # --- what is recorded --------------------------------------------------------------------------------------------

    def _committed(self) -> None:
        held, parts = self._store.load(), [np.zeros(0, ROBOT_REGISTER)]
        for robot, rows in sorted(held.registers.items()):
            part = np.zeros(len(rows), ROBOT_REGISTER)
            part["robot"] = robot
            for name in rows.dtype.names:
                part[name] = rows[name]
            parts.append(part)
        registers = np.concatenate(parts)
        glrm = fold_registers(PRIOR, registers, RULES)
        self.history.commits.append(Commit(held.version, registers, glrm, held.revoked))

    def _manager_stepped(self, frame: Frame, inbox: Sequence[Envelope], sent: Sequence[Sent]) -> None:
        self._overhear(keys.MANAGER, sent)
        for _, to, message in sent:
            robot = keys.split(to)[1]
            if isinstance(message, Ack) and robot in self._plan.robots:
                acked = message.acked
                self.history.acked.append(Acked(keys.robot_number(robot), message.epoch, acked["cell"], acked["seq"]))
            if isinstance(message, Fenced) and self._is_alive(robot, message):
                self.history.fenced.add((robot, message.epoch))

    def _is_alive(self, robot: str, fenced: Fenced) -> bool:
        """Whether an instance writes in the epoch that is fenced: the rest are echoes of the dead."""
        return any(
            machine.name == keys.node(keys.MAPPING, robot) and node._sync.epoch == fenced.epoch
            for machine, node in self._living()
        )

    def _living(self) -> list[tuple[Machine, RobotMappingNode]]:
        return [(m, m.node) for m in self._mappings if isinstance(m.node, RobotMappingNode)]

    def _mapping_stepped(self, machine: Machine, frame: Frame, inbox: Sequence[Envelope], sent: Sequence[Sent]) -> None:
        assert isinstance(machine.node, RobotMappingNode)
        self._overhear(machine.name, sent)
        name, sync, copy = self._name(machine), machine.node._sync, machine.node._sync.copy
        load = self.history.loads.setdefault(machine.name, Load())
        load.waiting = max(load.waiting, sync.waiting_cells)
        load.flights = max(load.flights, sync._outbox.flights)
        self._watch_fence(name, sync, frame.index, inbox, sent)
        batches = [len(message.records) for _, _, message in sent if isinstance(message, Batch)]
        load.batch_records = max([load.batch_records, *batches])
        if any(isinstance(envelope.message, Delta | Digest) for envelope in inbox) and self._is_judged(name, copy):
            sighting = Sighting(name, copy.manager_epoch, copy.version, copy.cells.copy(), len(self.history.commits))
            self.history.sightings.append(sighting)

    def _is_judged(self, name: str, copy: GlrmCopy) -> bool:
        """Not while it follows a forger, whom it heard first of all, or a lost store, nor while it gets over that."""
        if copy.manager_epoch == U4:
            self._misled.add(name)
        ours = copy.manager_epoch in self._manager_epochs and copy.version > 0
        return ours or not (self.history.lost_disks or name in self._misled)

    def _watch_fence(
        self, name: str, sync: RobotSync, frame: int, inbox: Sequence[Envelope], sent: Sequence[Sent]
    ) -> None:
        """One of two may come back if it heard nothing of the other for so long: for all it knows it is alone."""
        if sync.fenced:
            self._silent_since.setdefault(name, frame)
        acks = [envelope.message for envelope in inbox if isinstance(envelope.message, Ack)]
        if name in self._silent_since and any(
            0 < ack.epoch - sync._joining._last_epoch <= EPOCH_STEP_MAX for ack in acks
        ):
            self._silent_since[name] = frame
        if name in self._silent_since and any(isinstance(message, Hello) for _, _, message in sent):
            silent = frame - self._silent_since.pop(name) >= SILENCE_FRAMES
            self.history.returns += silent and bool(self._plan.twins)

    def _name(self, machine: Machine) -> str:
        """Of one life of one container."""
        return f"{machine.name}/{self._mappings.index(machine)}/{machine.lives}"

    def _overhear(self, sender: str, sent: Sequence[Sent]) -> None:
        room = OVERHEARD_MAX - len(self._overheard)
        between = [s for s in sent if keys.MAPPING in s[1] or s[1] == keys.MANAGER]
        self._overheard += [
            Envelope(plane, to, sender, 0, 0, message) for plane, to, message in between if plane == keys.RADIO
        ][:room]

    # --- what is said that nobody of ours would say ------------------------------------------------------------------

    def _meddle(self, frame: int) -> None:
        if self._rng.random() < 0.2 and self._overheard:
            old = self._overheard[int(self._rng.integers(len(self._overheard)))]
            self.network.carry(frame, [replace(old, frame=frame)])
        if self._draws.random() < 0.05 and all(node._sync.copy.manager_epoch for _, node in self._living()):
            self.network.carry(frame, [self._forged(frame)])
        manager, hangs = self._manager.node, frame < self._manager.hangs_until
        ails = hangs or self._store.full or self._store.fail_next
        if self._rng.random() < 0.1 and isinstance(manager, MapManagerNode) and not ails:
            self._send_rubbish(frame, manager)

    def _forged(self, frame: int) -> Envelope:
        """What an outsider says in the manager's name, of a life that there is not; a robot follows the first heard."""
        cells = np.zeros(3, CELL)
        cells["cell"], cells["version"], cells["height"] = (0, 1, 2), U4, 77_000
        tiles = np.zeros((Tiles(SCENARIO.grid.grid.shape).count, 16), np.uint8)
        lies = (
            Digest(U4, U4, tiles), Delta(U4, 0, U4, 0, 1, False, cells), Delta(U4, 0, U4, 0, 1, True, cells),
            Ack(U4, np.zeros(0, ACKED)),
        )  # fmt: skip
        lie = lies[int(self._draws.integers(len(lies)))]
        robot = keys.node(keys.MAPPING, str(self._draws.choice(self._plan.robots)))
        to = robot if isinstance(lie, Ack) else keys.group(keys.MAPPING)
        return Envelope(keys.RADIO, to, keys.MANAGER, frame, 0, lie)

    def _send_rubbish(self, frame: int, node: MapManagerNode) -> None:
        """One batch of a known robot's present epoch with something wrong in it: it must be counted and do nothing."""
        robot = self._plan.robots[0]
        records = np.zeros(2, UPDATE)
        records["cell"], records["confidence"], records["height"] = (0, 1), 200, 99_000
        records["seq"], records["tick"] = 1_000_000, frame * self._scenario.frame_ms
        spoiled = {"cell": SIZE, "confidence": 0, "tick": 2**32 - 1, "height": 2**31 - 1, "seq": 0}
        name = str(self._rng.choice(list(spoiled)))
        records[name][1] = spoiled[name]
        sync, sent = node._sync, list[Envelope]()

        def state() -> tuple[object, ...]:
            return sync.hash(), sync.version, sync.registers().tobytes(), self._store.commits

        def send(plane: str, to: str, message: Message) -> None:
            sent.append(Envelope(plane, to, keys.MANAGER, frame, len(sent), message))

        fails, self._store.fail_next = self._store.fail_next, None
        before, counted = state(), sync.rejected.total()
        batch = Envelope(
            keys.RADIO, keys.MANAGER, keys.node(keys.MAPPING, robot), frame, 0, Batch(sync.epoch(robot), records)
        )
        stamp_ns = frame * self._scenario.frame_ns
        node.step(Frame(frame, stamp_ns, self._scenario.frame_ns), [batch], send, lambda *note: None)
        self._store.fail_next = fails
        self.history.rejected_changes += state() != before or sync.rejected.total() != counted + 1
        self.network.carry(frame, sent)

    # --- the whole run -----------------------------------------------------------------------------------------------

    def run(self) -> History:
        for frame in range(STORM_FRAMES):
            self._break(frame)
            self._ask_for_revocations(frame)
            self._rounds.step()
            if self._plan.meddled:
                self._meddle(frame)
        self._heal()
        healed = max(STORM_FRAMES, self.network.last_due())
        for frame in range(STORM_FRAMES, STORM_FRAMES + END_WITHIN_FRAMES):
            self._ask_for_revocations(frame)
            self._rounds.step()
            rests = self._is_quiet()
            self._hear_end(frame, rests)
            if rests and frame >= healed and not self.history.quiet:
                self.history.quiet, self.history.heal_to_quiet_ms = True, (frame - healed) * self._scenario.frame_ms
            if self.history.quiet and (self.history.end or self._plan.twins):
                break
        return self._conclude(frame)

    def _hear_end(self, frame: int, rests: bool) -> None:
        for envelope in self.network.arrived(keys.WORLD, frame + 1):
            if isinstance(envelope.message, RunEnd) and self.history.end is None:
                self.history.end, self.history.rests_at_end = envelope.message, rests

    def _writers(self) -> list[RobotMappingNode]:
        return [node for _, node in self._living() if not node._sync.fenced and self._plan.keeps(node.name)]

    def _is_quiet(self) -> bool:
        if not isinstance(self._manager.node, MapManagerNode):
            return False
        writers, manager = self._writers(), self._manager.node._sync
        flushed = all(node._sync.flushed and self._is_told(node) for node in writers)
        copies = [node._sync.copy for _, node in self._living() if self._plan.keeps(node.name)]
        now = manager.manager_epoch, manager.version
        current = all((copy.manager_epoch, copy.version) == now for copy in copies)
        done = len(self.history.revoked) == len(self._plan.revocations)
        return flushed and current and done and len(writers) == len(self._plan.robots) - len(self.history.revoked)

    @staticmethod
    def _is_told(node: RobotMappingNode) -> bool:
        """Whether all its evidence was offered as it is now."""
        registers = node._mapper.registers()
        return bool(same_values(registers, node._sync.own[registers["cell"]], "tick").all())

    def _conclude(self, frame: int) -> History:
        history, node = self.history, self._manager.node or self._new_manager()
        assert isinstance(node, MapManagerNode)
        history.manager_hash, history.glrm = node._sync.hash(), node._sync.glrm.copy()
        history.registers = node._sync.registers()
        history.copy_hashes = {
            self._name(machine): mapping._sync.copy.hash()
            for machine, mapping in self._living()
            if self._plan.keeps(machine.name)
        }
        history.own = {keys.robot_number(keys.split(n.name)[1]): n._mapper.registers() for n in self._writers()}
        history.conflicts = len(self._plan.twins)
        history.restarts = self._lives - len(self._mappings)
        scanned = min(frame, self._scans_until)
        history.alone = {
            keys.robot_number(robot): mapped_alone(self._plan.seed, robot, scanned)
            for robot in self._plan.robots
            if self._plan.keeps(robot)
        }
        if self._plan.every_scan_counts:
            history.fault_free_hash = map_hash(_folded(history.alone))
        return history


def _folded(rows: dict[int, np.ndarray]) -> np.ndarray:
    """The map of these registers, robot number -> UPDATEs."""
    out = np.zeros(sum(map(len, rows.values())), ROBOT_REGISTER)
    out["robot"] = np.concatenate([np.full(len(row), robot) for robot, row in rows.items()])
    for name in UPDATE.names:
        out[name] = np.concatenate([row[name] for row in rows.values()])
    return fold_registers(PRIOR, out, RULES)


def run_storm(seed: int, cast: Cast = ALL_REAL) -> History:
    """The history of a seed's storm."""
    return Storm(plan_of(seed), cast).run()
