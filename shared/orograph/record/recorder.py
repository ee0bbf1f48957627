"""Writes what an observer hears of a run into one MCAP file, to be lost by no more than a second."""

from __future__ import annotations

import time
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path
from queue import Empty, Full, Queue
from types import TracebackType
from typing import Any, Final, Self

import numpy as np
from foxglove import Context, open_mcap

from orograph import keys
from orograph.comms import wire
from orograph.comms.observer import Heard
from orograph.control import Figures
from orograph.geometry import laser_position_m, quaternion, ray_directions, rotation
from orograph.judge.map_score import top_m
from orograph.messages import KINDS as ALL
from orograph.messages import SECOND_NS, Bodies, Delta, Message, Pose, Scan
from orograph.nodes.robot_mapping import ScanPoseSync
from orograph.points import points_from_ranges
from orograph.protocol.overheard import OverheardMap
from orograph.record.topics import Body, Topics
from orograph.registers import unpack
from orograph.scene.site import Site
from orograph.storage.parts import EventTail
from orograph.storage.run_folder import next_record, records

RADIO_KINDS: Final = tuple(kind for kind in ALL.values() if any(r.plane == keys.RADIO for r in kind.routes))
KINDS: Final[tuple[type[Message | Figures], ...]] = (*RADIO_KINDS, Bodies, Pose, Scan, Figures)
"""What is listened to: all of the map protocol and of missions, and what is needed to see a run."""
METADATA = "orograph"
PART_BYTES, PARTS_MAX = 2**28, 8
"""A record is cut into parts of about this size, of which so many are kept, the newest."""
WAITING_MAX = 20_000
FLUSH_S = 0.5
MAP_EVERY_NS = 10 * SECOND_NS
SCAN_EVERY_NS, SCAN_COLUMNS = SECOND_NS, 4
"""Of each robot one scan a second is kept, every fourth column of it; with `full_scans` all of all."""
SCAN_WAIT_NS = SECOND_NS // 2


class Recorder:
    """A context manager; `hear` is called from the observer's threads, `write` by one thread in turns."""

    def __init__(
        self, site: Site, folder: Path, metadata: Mapping[str, str], full_scans: bool = False,
        part_bytes: int = PART_BYTES,
    ) -> None:  # fmt: skip
        """`folder` is the run's, in which its services note events and the parts of the record are left."""
        self._site, self._folder, self._full_scans, self._part_bytes = site, folder, full_scans, part_bytes
        self._waiting: Queue[Heard] = Queue(WAITING_MAX)
        self.dropped = 0
        """Heard and not written, because the disk was slower than the run."""
        self._context, self._metadata = Context(), {**metadata, "scenario": site.scenario.model_dump_json()}
        self._topics = Topics(self._context)
        self._begin_part()
        self._overheard = OverheardMap(site.prior)
        self._scanned = {robot: ScanPoseSync(SCAN_WAIT_NS) for robot in site.scenario.robot_ids}
        self._scan_due_ns = dict.fromkeys(self._scanned, 0)
        self._directions = ray_directions(site.scenario.laser)
        self._now_ns, self._tail = 0, EventTail(folder)
        self._flushed_s = 0.0

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, _: TracebackType | None) -> None:
        """Write what still waits, and the map as it ended."""
        self.write(0.0)
        if self._changed:
            self._draw_map()
        self._file.close()

    def hear(self, heard: Heard) -> None:
        """Take one message, or count it where too many wait."""
        try:
            self._waiting.put_nowait(heard)
        except Full:
            self.dropped += 1

    def write(self, patience_s: float) -> None:
        """Write what waits, for which this waits at most so long; twice a second all is made safe."""
        with suppress(Empty):
            self._take(self._waiting.get(timeout=patience_s))
        self._take_waiting()
        if time.monotonic() - self._flushed_s >= FLUSH_S:
            self.safe()

    def safe(self) -> None:
        """Write what waits; nothing of it can be lost any more."""
        self._take_waiting()
        self._note_events()
        self._file.flush()
        self._flushed_s = time.monotonic()
        if self.path.stat().st_size > self._part_bytes:
            self._file.close()
            self._begin_part()

    def _take_waiting(self) -> None:
        while not self._waiting.empty():
            self._take(self._waiting.get_nowait())

    def _begin_part(self) -> None:
        """Open the next file, which can be looked at by itself; the oldest go, so that a day does not fill the disk."""
        self.path = next_record(self._folder)
        self._file = open_mcap(self.path, context=self._context)
        self._file.write_metadata(METADATA, self._metadata)
        self._map_due_ns, self._changed = 0, True
        for old in records(self._folder)[:-PARTS_MAX]:
            old.unlink()

    def _take(self, heard: Heard) -> None:
        stamp_ns = heard.frame * self._site.scenario.frame_ns
        self._now_ns = max(self._now_ns, stamp_ns)
        message = heard.message
        if isinstance(message, RADIO_KINDS):
            key = keys.message_key(keys.RADIO, heard.to, type(message).__name__, heard.sender)
            self._topics.raw(stamp_ns, key, wire.encode(message))
        match message:
            case Figures(figures=figures):
                self._topics.figures(self._now_ns, heard.sender, figures)
            case Bodies() as bodies:
                self._topics.bodies(bodies.stamp_ns, self._frames(bodies))
            case Delta() as delta:
                self._changed |= len(self._overheard.take(delta)) > 0
            case Scan() as scan:
                self._take_scan(keys.split(heard.to)[1], scan)
            case Pose() as pose:
                self._take_scan(keys.split(heard.sender)[1], pose)
        if self._changed and self._now_ns >= self._map_due_ns:
            self._draw_map()

    def _frames(self, bodies: Bodies) -> list[Body]:
        robots = len(bodies.poses) - len(self._site.scenario.vehicles)
        names = [keys.robot_id(i + 1) for i in range(robots)]
        names += [f"vehicle_{i:03d}" for i in range(len(bodies.poses) - robots)]
        return [(name, pose["position_m"], pose["quaternion_wxyz"])
                for name, pose in zip(names, bodies.poses, strict=True) if pose["present"]]  # fmt: skip

    def _draw_map(self) -> None:
        cells = unpack(self._overheard.cells, self._site.scenario.grid.grid, *self._site.given)
        self._topics.map(self._now_ns, cells, top_m(cells))
        self._map_due_ns, self._changed = self._now_ns + MAP_EVERY_NS, False

    def _take_scan(self, robot: str, seen: Scan | Pose) -> None:
        """A scan is drawn where the robot believed itself to be, which is a frame of its own."""
        if robot not in self._scanned:
            return
        self._scanned[robot].take(seen)
        for scan, pose in self._scanned[robot].pairs(seen.stamp_ns):
            if not self._full_scans and scan.stamp_ns < self._scan_due_ns[robot]:
                continue
            self._scan_due_ns[robot] = scan.stamp_ns + SCAN_EVERY_NS
            R_map_robot = rotation(pose.roll_rad, pose.pitch_rad, pose.yaw_rad)
            position_m = np.array([pose.x_m, pose.y_m, pose.z_m])
            eye_m = laser_position_m(self._site.scenario.laser, R_map_robot, position_m)
            kept = slice(None, None, 1 if self._full_scans else SCAN_COLUMNS)
            points_m, _ = points_from_ranges(scan.ranges[:, kept], self._directions[:, kept], R_map_robot, eye_m)
            self._topics.scan(scan.stamp_ns, robot, points_m)
            self._topics.bodies(scan.stamp_ns, [(f"{robot}/believed", position_m, quaternion(R_map_robot))])

    def _note_events(self) -> None:
        """What is new of the events that the services noted."""
        for event in self._tail.news():
            self._topics.event(
                int(event.get("stamp_ns", 0)), str(event.get("robot") or event.get("service")), _line(event)
            )


def _line(event: Mapping[str, Any]) -> str:
    rest = {k: v for k, v in event.items() if k not in ("stamp_ns", "service", "robot", "event")}
    return f"{event.get('event')} {rest}" if rest else str(event.get("event"))
