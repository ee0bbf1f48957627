"""One seeded fault run over the real protocol objects: robots drive and scan while the network and the machines fail.

Everything follows from the seed: the plan of faults, every message's fate, every scan. A run is: faults for some
seconds, then heal, then the flush, then quiet; the checkers judge the history.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from orograph.messages import ACKED, CELL, ROBOT_REGISTER, U4, UPDATE, Ack, Batch, Delta, Digest, Fenced
from orograph.protocol.downlink import SendTo
from orograph.protocol.fold import fold_registers
from orograph.protocol.limits import Limits
from orograph.protocol.manager import ManagerSync
from orograph.protocol.robot import RobotSync
from orograph.protocol.store import Changes, MemoryStore, StoredState, StoreFailed
from orograph.rules import DEFAULT
from simnet.history import Acked, Commit, History, Load, Sighting
from simnet.mapper import Mapper
from simnet.network import Network

SHAPE = (24, 9)
"""216 cells, two tiles: small enough to be quick, large enough that tiles differ."""
SIZE = SHAPE[0] * SHAPE[1]
FRAME_MS = 200
STORM_FRAMES = 60
QUIET_WITHIN_FRAMES = 400
SMALL = Limits(batch_cells=20, largest_change_share=5, part_cells=24, answers_per_step=3, parts_per_robot=2)
"""Cut down to this small map, so that answers come in parts and batches wait for room."""


def make_prior() -> np.ndarray:
    prior = np.zeros(SIZE, UPDATE)
    prior["cell"] = np.arange(SIZE)
    prior["confidence"], prior["height"], prior["occupation"] = 4, 10 * np.arange(SIZE), 20
    return prior


PRIOR = make_prior()


@dataclass
class Faults:
    """What may go wrong in a storm; all off is the fault-free run over the same scans."""

    network: bool = True
    links: bool = True
    robot_restarts: bool = True
    manager_crashes: bool = True
    disk: bool = True
    twins: bool = False
    replays: bool = True
    forgeries: bool = True
    lost_disk: str = ""
    """`gone`: the manager comes back with an empty store; `older`: with what it held long before."""


NONE = Faults(*[False] * 8)


class RecordedStore(MemoryStore):
    """Tells the history of every commit that became durable."""

    def __init__(self, history: History, held: StoredState | None = None) -> None:
        super().__init__()
        self._history = history
        self._held = held or self._held

    def commit(self, changes: Changes) -> None:
        before = self.commits
        try:
            super().commit(changes)
        finally:
            if self.commits > before:
                self._history.commits.append(self._as_commit())

    def _as_commit(self) -> Commit:
        held = self.load()
        parts = []
        for robot in sorted(held.registers):
            rows = held.registers[robot]
            part = np.zeros(len(rows), ROBOT_REGISTER)
            part["robot"] = robot
            for name in rows.dtype.names:
                part[name] = rows[name]
            parts.append(part)
        registers = np.concatenate(parts) if parts else np.zeros(0, ROBOT_REGISTER)
        return Commit(held.version, registers, fold_registers(PRIOR, registers, DEFAULT))


@dataclass
class Instance:
    """One process of one robot: its protocol object and its mapper; lost together."""

    robot: str
    number: int
    sync: RobotSync
    mapper: Mapper = field(default_factory=lambda: Mapper(SIZE))


class Storm:
    """State of one run; `run` plays it to the end."""

    def __init__(
        self, seed: int, faults: Faults, robot_class: type[RobotSync] = RobotSync,
        manager_class: type[ManagerSync] = ManagerSync,
    ) -> None:  # fmt: skip
        self.seed, self.faults = seed, faults
        self._robot_class, self._manager_class = robot_class, manager_class
        self._rng, self._draws = np.random.default_rng([seed, 1]), np.random.default_rng([seed, 4])
        self._network = Network(np.random.default_rng([seed, 2]))
        self.history = History(SIZE, prior=PRIOR)
        self._store = RecordedStore(self.history)
        self._backup = self._store.load()
        self._lives: set[int] = set()
        """Manager epochs of the present store."""
        self._robots = tuple(f"robot_{i:03d}" for i in range(1, 2 + seed % 3 + 1))
        self._instances: list[Instance] = []
        self._started = 0
        for robot in self._robots:
            self._start(robot)
        self.history.restarts = 0
        self._manager: ManagerSync | None = self._new_manager()
        self._manager_down_until = self._disk_full_until = 0
        self._overheard: list[tuple[str, object]] = []

    # --- machines ----------------------------------------------------------------------------------------------------

    def _start(self, robot: str) -> None:
        self._started += 1
        self.history.restarts += 1
        nonce = self.seed.to_bytes(8, "little") + self._started.to_bytes(8, "little")
        sync = self._robot_class(robot, SHAPE, PRIOR, nonce, self.seed, SMALL)
        self._instances.append(Instance(robot, self._started, sync))

    def _new_manager(self) -> ManagerSync:
        draw = int(self._draws.integers(2**31))
        manager = self._manager_class(SHAPE, PRIOR, DEFAULT, self._store, self._robots, limits=SMALL, draw=draw)
        self._lives.add(manager.manager_epoch)
        return manager

    def _restart_robot(self, robot: str) -> None:
        self._instances = [instance for instance in self._instances if instance.robot != robot]
        self._start(robot)

    def _lose_disk(self, frame: int) -> None:
        """From here on the new store is judged; what the old one acknowledged only the robots still have."""
        self._manager, self._manager_down_until = None, frame + 5
        self._store = RecordedStore(self.history, self._backup if self.faults.lost_disk == "older" else None)
        self._lives.clear()
        self.history.lost_disks += 1
        for judged in (self.history.acked, self.history.commits, self.history.sightings):
            judged.clear()

    def _forge(self, instance: Instance) -> list[object]:
        """What an outsider says in the manager's name, of a life that there is not, once the robot knows of one."""
        if not self.faults.forgeries or self._draws.random() > 0.03 or not instance.sync.copy.manager_epoch:
            return []
        cells = np.zeros(3, CELL)
        cells["cell"], cells["version"], cells["height"] = (0, 1, 2), U4, 77_000
        lies = (
            Digest(U4, U4, np.zeros((2, 16), np.uint8)), Delta(U4, 0, U4, 0, 1, False, cells),
            Delta(U4, 0, U4, 0, 1, True, cells), Ack(U4, np.zeros(0, ACKED)),
        )  # fmt: skip
        return [lies[int(self._draws.integers(len(lies)))]]

    def _recover_manager(self) -> None:
        self._manager = self._new_manager()
        self.history.recovered.append((self._manager.hash(), self._new_manager().hash()))

    # --- the plan of faults ------------------------------------------------------------------------------------------

    def _break_something(self, frame: int) -> None:
        faults, draw, weather = self.faults, self._rng.random(8), self._network.weather
        robot = self._robots[int(self._rng.integers(len(self._robots)))]
        if faults.network and draw[0] < 0.15:
            weather.loss, weather.double, weather.late = (float(x) for x in self._rng.choice([0, 0.1, 0.3, 0.5], 3))
            weather.late_frames_max = int(self._rng.integers(1, 26))
        if faults.links and draw[1] < 0.1:
            for cut in (weather.cut_up, weather.cut_down):
                if self._rng.random() < 0.6:
                    cut.symmetric_difference_update({robot})
        if faults.robot_restarts and draw[2] < 0.03:
            self._restart_robot(robot)
        if faults.manager_crashes and draw[3] < 0.025 and self._manager is not None:
            self._manager, self._manager_down_until = None, frame + int(self._rng.integers(1, 10))
        if faults.disk and draw[4] < 0.025:
            self._disk_full_until = frame + int(self._rng.integers(1, 9))
        if faults.disk and draw[5] < 0.05:
            self._store.fail_next = str(self._rng.choice(["lost", "kept"]))
        if frame == STORM_FRAMES // 3:
            self._backup = self._store.load()
        if faults.lost_disk and frame == STORM_FRAMES * 2 // 3:
            self._lose_disk(frame)
        if faults.twins and frame == STORM_FRAMES // 3:
            self.history.conflicts += 1
            self._start(robot)
        if faults.replays and draw[7] < 0.2 and self._overheard:
            sender, message = self._overheard[int(self._rng.integers(len(self._overheard)))]
            self._network.send_up(frame, sender, message)

    def _heal(self) -> None:
        self._network.weather.loss = self._network.weather.double = self._network.weather.late = 0.0
        self._network.weather.cut_up.clear()
        self._network.weather.cut_down.clear()
        self._store.fail_next, self._disk_full_until, self._manager_down_until = None, 0, 0

    # --- one frame ---------------------------------------------------------------------------------------------------

    def _step_manager(self, frame: int) -> None:
        inbox = self._network.arrived_up(frame)
        self._store.full = frame < self._disk_full_until
        if self._manager is None:
            if frame < self._manager_down_until:
                return
            self._recover_manager()
        assert self._manager is not None

        def send(robot: str | None, message: object) -> None:
            if isinstance(message, Ack):
                acked = Acked(int(robot[-3:]), message.epoch, message.acked["cell"], message.acked["seq"])
                self.history.acked.append(acked)
            if isinstance(message, Fenced) and self._is_alive(robot, message):
                self.history.fenced.add((str(robot), message.epoch))
            for to in self._robots if robot is None else (robot,):
                self._network.send_down(frame, to, message)

        try:
            self._manager.step(frame * FRAME_MS * 1_000_000, inbox, send)
            if self.faults.replays and not self._store.full and self._rng.random() < 0.1:
                self._send_rubbish(frame, send)
        except StoreFailed:
            self._manager, self._manager_down_until = None, frame + 2

    def _send_rubbish(self, frame: int, send: SendTo) -> None:
        """One batch of a known robot's present epoch with something wrong in it: it must be counted and do nothing."""
        manager, robot = self._manager, self._robots[0]
        assert manager is not None
        records = np.zeros(2, UPDATE)
        records["cell"], records["confidence"], records["height"] = (0, 1), 200, 99_000
        records["seq"], records["tick"] = 1_000_000, frame * FRAME_MS
        spoiled = {"cell": SIZE, "confidence": 0, "tick": 2**32 - 1, "height": 2**31 - 1, "seq": 0}
        name = str(self._rng.choice(list(spoiled)))
        records[name][1] = spoiled[name]

        def state() -> tuple[object, ...]:
            return manager.hash(), manager.version, manager.registers().tobytes(), self._store.commits

        before, counted = state(), manager.rejected.total()
        manager.step(frame * FRAME_MS * 1_000_000, [(robot, Batch(manager.epoch(robot), records))], send)
        self.history.rejected_changes += state() != before or manager.rejected.total() != counted + 1

    def _is_alive(self, robot: str | None, fenced: Fenced) -> bool:
        """Whether an instance writes in the epoch that is fenced: the rest are echoes of the dead."""
        return any(x.robot == robot and x.sync.epoch == fenced.epoch for x in self._instances)

    def _scan(self, instance: Instance, frame: int) -> None:
        """What an instance sees depends on (seed, robot, frame) alone, so a run without faults sees the same."""
        rng = np.random.default_rng([self.seed, 3, int(instance.robot[-3:]), frame])
        first = int(rng.integers(SIZE - 12))
        cells = first + np.flatnonzero(rng.random(12) < 0.6)
        heights = 1000 + 37 * cells + rng.integers(-200, 200, len(cells)) + 2000 * (rng.random(len(cells)) < 0.05)
        instance.sync.offer(instance.mapper.scan(cells, heights.astype(np.int64), frame * FRAME_MS))

    def _step_robot(self, instance: Instance, inbox: list[object], frame: int) -> None:
        load = self.history.loads.setdefault(instance.robot, Load())
        sent = 0

        def send(message: object) -> None:
            nonlocal sent
            sent += 1
            if isinstance(message, Batch):
                load.batch_records = max(load.batch_records, len(message.records))
            if len(self._overheard) < 400:
                self._overheard.append((instance.robot, message))
            self._network.send_up(frame, instance.robot, message)

        before = (instance.sync.copy.manager_epoch, instance.sync.copy.version)
        result = instance.sync.step(frame * FRAME_MS * 1_000_000, inbox, send)
        instance.mapper.acknowledge(result.acknowledged)
        instance.mapper.adopt(result.adopted, result.first_life)
        load.waiting = max(load.waiting, instance.sync.waiting_cells)
        load.flights = max(load.flights, int(instance.sync.telemetry()["batches_in_flight"]))
        load.messages_per_step = max(load.messages_per_step, sent)
        copy = instance.sync.copy
        changed = (copy.manager_epoch, copy.version) != before or any(isinstance(message, Delta) for message in inbox)
        old_store = copy.manager_epoch not in self._lives or not copy.version
        if changed and not (self.history.lost_disks and old_store):
            name = f"{instance.robot}/{instance.number}"
            sighting = Sighting(name, copy.manager_epoch, copy.version, copy.cells.copy(), len(self.history.commits))
            self.history.sightings.append(sighting)

    def _frame(self, frame: int, scanning: bool) -> None:
        self._step_manager(frame)
        inboxes = {robot: self._network.arrived_down(frame, robot) for robot in self._robots}
        for instance in self._instances:
            if scanning and frame % 2 == 0:
                self._scan(instance, frame)
            if not scanning:
                instance.sync.offer(instance.mapper.unacknowledged())
            self._step_robot(instance, inboxes[instance.robot] + self._forge(instance), frame)

    # --- the whole run -----------------------------------------------------------------------------------------------

    def run(self) -> History:
        for frame in range(STORM_FRAMES):
            self._break_something(frame)
            self._frame(frame, scanning=True)
        self._heal()
        healed = STORM_FRAMES
        for frame in range(STORM_FRAMES, STORM_FRAMES + QUIET_WITHIN_FRAMES):
            self._frame(frame, scanning=False)
            if self._network.late(frame):
                healed = frame
            elif self._is_quiet():
                self.history.quiet = True
                self.history.heal_to_quiet_ms = (frame - healed) * FRAME_MS
                break
        return self._conclude()

    def _writers(self) -> list[Instance]:
        return [instance for instance in self._instances if not instance.sync.fenced]

    def _is_quiet(self) -> bool:
        if self._manager is None:
            return False
        writers = self._writers()
        flushed = all(x.sync.flushed and not len(x.mapper.unacknowledged()) for x in writers)
        now = self._manager.manager_epoch, self._manager.version
        current = all((x.sync.copy.manager_epoch, x.sync.copy.version) == now for x in self._instances)
        return flushed and current and len(writers) == len(self._robots)

    def _conclude(self) -> History:
        history = self.history
        if self._manager is None:
            self._recover_manager()
        assert self._manager is not None
        history.manager_hash, history.glrm = self._manager.hash(), self._manager.glrm.copy()
        history.registers = self._manager.registers()
        history.copy_hashes = {f"{x.robot}/{x.number}": x.sync.copy.hash() for x in self._instances}
        for instance in self._writers():
            evidence = instance.mapper.evidence
            history.own[int(instance.robot[-3:])] = evidence[evidence["confidence"] > 0]
        return history


def storm_of(seed: int) -> Faults:
    """Every third seed keeps the robots' memory, so that invariant 11 is judged; every seventh has a twin.

    In every fifth the manager loses its disk, and has no twin: of two that claim one robot's evidence one lost its
    memory with that disk.
    """
    lost_disk = ("gone", "older")[seed % 2] if seed % 5 == 4 else ""
    if seed % 3 == 0:
        return Faults(robot_restarts=False, lost_disk=lost_disk)
    return Faults(twins=seed % 7 == 0 and not lost_disk, lost_disk=lost_disk)


def run_storm(
    seed: int, robot_class: type[RobotSync] = RobotSync, manager_class: type[ManagerSync] = ManagerSync,
    compare: bool = True,
) -> History:  # fmt: skip
    """The history of a seed's storm, with the fault-free map to compare where that is promised (if `compare`)."""
    faults = storm_of(seed)
    history = Storm(seed, faults, robot_class, manager_class).run()
    if compare and not (faults.robot_restarts or faults.twins):
        history.fault_free_hash = Storm(seed, NONE).run().manager_hash
    return history
