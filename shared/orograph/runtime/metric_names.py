"""The one table of what a node tells about itself and under which name, kind and help Prometheus has it.

Names follow Prometheus: base units, `_total` on counters. A row's key is the figure's name in `Node.telemetry()`; a
word in braces stands for the value of a label: `points_{reason}`.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from typing import Literal

from orograph import keys

Kind = Literal["counter", "gauge"]


@dataclass(frozen=True)
class Metric:
    """One exported family; `known` are the values of its own label that are shown from the start, as 0."""

    name: str
    kind: Kind
    help: str
    known: tuple[str, ...] = ()


def _counter(name: str, help_text: str, known: tuple[str, ...] = ()) -> Metric:
    return Metric(f"orograph_{name}_total", "counter", help_text, known)


def _gauge(name: str, help_text: str) -> Metric:
    return Metric(f"orograph_{name}", "gauge", help_text)


WIRE_REASONS = (
    "kind", "size", "keys", "schema", "msgpack", "type", "range", "shape", "crc", "doubled", "frame", "key", "route",
    "robot",
)  # fmt: skip
"""Why `comms`, `keys` and `routes` refuse what came off the wire."""
INPUT_REASONS = (
    "shape", "cell_range", "duplicate_cell", "no_evidence", "height_range", "future_tick", "tile_range", "unexpected",
    "unknown_robot", "flood", "fenced_epoch", "unknown_epoch", "other_life", "revoked",
)  # fmt: skip
"""Why the Map Manager refuses a robot's message."""
POINT_REASONS = ("not_finite", "below_range", "beyond_range", "outside_grid", "outside_map")

WORLD = {
    "robots": _gauge("world_robots", "Robots that have a body."),
    "vehicles": _gauge("world_vehicles", "Moving vehicles."),
    "contacts": _counter("world_contacts", "Collisions of robots with buildings, vehicles and each other."),
    "robots_without_radio": _gauge("world_robots_without_radio", "Robots where the communications layer is 0."),
    "frame": _counter("world_frames", "Frames of simulation stepped."),
}
LASER = {
    "scans": _counter("laser_scans", "Range images made."),
    "hits_fraction": _gauge("laser_hits_ratio", "Share of the last scan's rays that came back."),
}
MANAGER = {
    "manager_epoch": _gauge(
        "map_epoch", "Number of the Map Manager's life: grows with each, a store's first is random."
    ),
    "version": _gauge("map_version", "Version of the global map, one per commit."),
    "confident_cells": _gauge("map_confident_cells", "Cells of the global map that are confident."),
    "cells": _gauge("map_cells", "Cells of the global map."),
    "store_full": _gauge("store_full", "1 while the store's disk is full."),
    "surface_changes": _counter("map_surface_changes", "Cells on which something appeared or from which it went."),
    "robots_revoked": _gauge("map_robots_revoked", "Robots whose registers were taken out of the map for good."),
    "commits": _counter("store_commits", "Commits of robots' records."),
    "commits_refused": _counter("store_commits_refused", "Commits that the store refused for want of room."),
    "records_acked": _counter("map_records_acknowledged", "Records acknowledged to robots."),
    "repeated_records": _counter("map_records_repeated", "Records that came again and changed nothing."),
    "fenced": _counter("map_fencings", "Messages of a replaced instance that were answered `fenced`."),
    "rejected_{reason}": _counter("map_inputs_rejected", "Robots' messages that were refused.", INPUT_REASONS),
    "beats": _counter("map_beats", "Deltas published to all copies."),
    "digests": _counter("map_digests", "Digests published to all copies."),
    "answers": _counter("map_answers", "Repairs sent to copies that asked."),
}
ORCHESTRATOR = {
    "phase": _gauge("run_phase", "0 mapping, 1 flush, 2 end."),
    "robots_heard": _gauge("robots_heard", "Robots of which the orchestrator has a fresh status."),
    "waypoints_left": _gauge("patrol_waypoints_left", "Waypoints of the patrol that nobody has visited."),
    "waypoints_unreached": _gauge("patrol_waypoints_unreached", "Waypoints given up as out of reach."),
    "silence_{robot}_s": _gauge("robot_silence_seconds", "Simulation time since a robot's last status."),
}
NAVIGATOR = {
    "position_sigma_m": _gauge("navigator_position_sigma_meters", "One sigma of the estimated position."),
    "driven_m": _counter("navigator_driven_meters", "Distance driven by the wheels' count."),
    "global_replans": _counter("navigator_global_replans", "Paths planned on the global map."),
    "local_replans": _counter("navigator_local_replans", "Paths planned on the local map."),
    "recoveries": _counter("navigator_recoveries", "Times that a stuck robot backed out."),
    "waypoints_left": _gauge("navigator_waypoints_left", "Waypoints of the present order that are left."),
    "state": _gauge("navigator_state", "0 idle, 1 driving, 2 blocked, 3 recovering, 4 returning, 5 done."),
}
MAPPING = {
    "scans": _counter("mapping_scans", "Scans mapped."),
    "scans_skipped": _counter("mapping_scans_skipped", "Scans forgotten because their pose never came."),
    "points_{reason}": _counter("mapping_points_dropped", "Laser points that were not mapped.", POINT_REASONS),
    "link_up": _gauge("radio_link_up", "1 while the Map Manager was heard within 5 s of simulation time."),
    "epoch": _gauge("uplink_epoch", "Epoch that this instance writes in; 0 before it is welcomed."),
    "fenced": _gauge("uplink_fenced", "1 once a later instance has this robot."),
    "fencings": _counter("uplink_fencings", "Times that this instance was fenced."),
    "hellos": _counter("uplink_hellos", "Hellos sent."),
    "waiting_cells": _gauge("uplink_unacknowledged_cells", "Cells that the Map Manager has not acknowledged."),
    "oldest_waiting_s": _gauge(
        "uplink_oldest_unacknowledged_seconds", "Simulation time that the oldest such cell has waited."
    ),
    "batches_in_flight": _gauge("uplink_batches_in_flight", "Batches sent and not yet answered."),
    "batches_sent": _counter("uplink_batches_sent", "Batches sent."),
    "batches_unanswered": _counter("uplink_batches_unanswered", "Batches given up as lost, so sent again."),
    "records_sent": _counter("uplink_records_sent", "Records sent."),
    "records_acked": _counter("uplink_records_acknowledged", "Records acknowledged."),
    "registers_lost": _counter(
        "uplink_registers_lost", "Registers that the Map Manager had acknowledged and no longer held when it came back."
    ),
    "foreign_acks": _counter(
        "uplink_foreign_acks", "Acknowledgements of an epoch that this instance does not write in."
    ),
    "unexpected": _counter("uplink_unexpected_messages", "Messages of a kind that no robot expects."),
    "copy_version": _gauge("copy_version", "Version of this robot's copy of the global map."),
    "copy_gaps": _counter("copy_gaps", "Deltas that began after where the copy stood."),
    "copy_requests": _counter("copy_requests", "Repairs asked for."),
    "copy_repairs": _counter("copy_repairs", "Parts of repairs that came."),
    "copy_digest_matches": _counter("copy_digest_matches", "Digests that the copy agreed with in every tile."),
    "copy_mismatches": _counter("copy_digest_mismatches", "Digests that differed from the copy."),
    "copy_rejected": _counter("copy_rejected_messages", "Deltas and digests that fit no map of this shape."),
    "copy_strangers": _counter("copy_strangers", "Deltas and digests of another Map Manager than the one followed."),
    "copy_misled": _counter("copy_misled", "Times that all digests were older than the copy, which began anew."),
}
ROUTER_NODE = "router"
"""A router's name among the nodes; it has no step object and takes no part in a frame."""
ROUTER = {"transports": _gauge("router_transports", "Sessions and other routers linked to this router.")}
TELEMETRY: Mapping[str, Mapping[str, Metric]] = {
    keys.WORLD: WORLD, keys.LASER: LASER, keys.MANAGER: MANAGER, keys.ORCHESTRATOR: ORCHESTRATOR,
    keys.NAVIGATOR: NAVIGATOR, keys.MAPPING: MAPPING, ROUTER_NODE: ROUTER,
}  # fmt: skip
"""Per service: the figures of its nodes. Those of a robot's services carry the label `robot`."""

SUMS = {(keys.MANAGER, "rejected")}
"""Figures that are the sum of others here and are not exported a second time."""

PROCESS = {
    "simulation_s": _counter("simulation_seconds", "Simulation time of the newest frame that this process stepped."),
    "time_scale": _gauge("time_scale_ratio", "The pace that the world keeps to; 0 in lockstep, as fast as it goes."),
    "robots_held": _gauge("robots_held", "Robots that this process serves; 0 is a spare."),
    "mailbox_waiting": _gauge("mailbox_messages", "Messages received and not yet stepped with."),
    "lost": _counter("mailbox_lost_messages", "Counted messages that never came."),
    "overflowed": _counter("mailbox_overflowed_messages", "Messages dropped because the mailbox was full."),
    "forgotten": _counter("mailbox_forgotten_messages", "Messages of which fragments were dropped for want of room."),
    "skipped": _counter("mailbox_skipped_messages", "Messages that a newer one of the same stream replaced."),
    "rejected_{reason}": _counter("mailbox_rejected_messages", "Fragments refused off the wire.", WIRE_REASONS),
    "callback_errors_{callback}": _counter(
        "callback_errors", "What Zenoh's threads brought and this process could not take.", keys.CALLBACKS
    ),
    "sent_bytes_{plane}": _counter("sent_bytes", "Bytes of messages sent.", keys.PLANES),
    "received_bytes_{plane}": _counter("received_bytes", "Bytes of messages received.", keys.PLANES),
    "zenoh_transports_{plane}": _gauge("zenoh_transports", "Zenoh links that are up."),
    "rss_max_bytes": _gauge("peak_resident_memory_bytes", "Peak resident memory of this process."),
}
"""Figures of a process as a whole, whatever it holds."""


@dataclass(frozen=True)
class Place:
    """Where a figure belongs: its family, and the label taken from its name."""

    metric: Metric
    labels: tuple[tuple[str, str], ...] = ()


def place(table: Mapping[str, Metric], figure: str) -> Place | None:
    """The family and labels of a figure, None for one that the table does not know."""
    if figure in table:
        return Place(table[figure])
    for pattern, metric in table.items():
        if "{" in pattern and (found := _compiled(pattern).fullmatch(figure)):
            return Place(metric, tuple(found.groupdict().items()))
    return None


def label_of(pattern: str) -> str | None:
    """The label that a row's key has a place for."""
    found = re.search(r"\{(\w+)\}", pattern)
    return found[1] if found else None


@cache
def _compiled(pattern: str) -> re.Pattern[str]:
    values = {
        "robot": keys.ROBOT_ID.pattern, "plane": "|".join(keys.PLANES), "callback": "|".join(keys.CALLBACKS),
        "reason": r"[a-z][a-z_]{0,39}",
    }  # fmt: skip
    label = label_of(pattern)
    assert label is not None
    before, after = pattern.split("{" + label + "}")
    return re.compile(f"{re.escape(before)}(?P<{label}>{values[label]}){re.escape(after)}")
