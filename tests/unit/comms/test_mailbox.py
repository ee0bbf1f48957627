"""The mailbox: counted messages are awaited, lost ones are named, order never depends on arrival."""

import threading
import time

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from orograph import keys
from orograph.comms import mailbox, wire
from orograph.comms.mailbox import AHEAD_FRAMES_MAX, CUT_PATIENCE_S, Mailbox, streams_to
from orograph.messages import (
    CELL,
    KINDS,
    POSE,
    Bodies,
    Delta,
    Drive,
    Hello,
    Message,
    Mission,
    OccupancyGrid,
    Pose,
    Scan,
)

STOP = threading.Event()
ROBOTS = ("robot_001", "robot_002")


def _put(box: Mailbox, plane: str, to: str, sender: str, message: Message, frame: int = 0, index: int = 0) -> None:
    for piece in wire.fragments(frame, index, wire.encode(message)):
        box.add(keys.message_key(plane, to, type(message).__name__, sender), piece)


def _post(box: Mailbox, sender: str, frame: int, index: int) -> None:
    _put(box, keys.SIM, "world", sender, Drive(frame, float(index), 0.0), frame, index)


def test_messages_come_out_by_sender_and_index_whatever_the_arrival() -> None:
    box = Mailbox(ROBOTS)
    for sender, index in [("navigator/robot_002", 0), ("navigator/robot_001", 1), ("navigator/robot_001", 0)]:
        _post(box, sender, 4, index)
    taken = [(e.sender, e.index) for e in box.take(5, newest_only=False)]
    assert taken == [("navigator/robot_001", 0), ("navigator/robot_001", 1), ("navigator/robot_002", 0)]
    assert box.take(5, newest_only=False) == []


def test_a_message_of_this_frame_waits_for_the_next() -> None:
    box = Mailbox(ROBOTS)
    _post(box, "navigator/robot_001", 5, 0)
    assert box.take(5, newest_only=False) == []
    assert len(box.take(6, newest_only=False)) == 1


def test_a_counted_message_is_awaited() -> None:
    box = Mailbox(ROBOTS)
    threading.Timer(0.05, _post, (box, "navigator/robot_001", 7, 0)).start()
    assert box.await_counted(7, {(keys.SIM, "world", "navigator/robot_001"): 1}, STOP) == 0


def test_a_lost_message_is_given_up_once_and_the_plane_is_then_not_trusted() -> None:
    box = Mailbox(ROBOTS)
    box_patience = {(keys.RADIO, "map-manager", "robot-mapping/robot_001"): 2}
    _put(box, keys.RADIO, "map-manager", "robot-mapping/robot_001", Hello(bytes(16)), frame=1)
    assert box.await_counted(1, box_patience, STOP) == 1
    begin = time.monotonic()
    assert box.await_counted(2, box_patience, STOP) == 2
    assert time.monotonic() - begin < 20 * CUT_PATIENCE_S
    assert box.counts["lost"] == 3


def test_a_stream_late_in_paced_time_keeps_its_newest_and_counts_the_rest() -> None:
    box = Mailbox(ROBOTS)
    for frame in range(3):
        _put(box, keys.SIM, "laser/*", "world", Bodies(frame, np.zeros(1, POSE)), frame)
        _post(box, "navigator/robot_001", frame, 0)
    taken = box.take(3, newest_only=True)
    assert [e.message.stamp_ns for e in taken if isinstance(e.message, Bodies)] == [2]
    assert sum(isinstance(e.message, Drive) for e in taken) == 3
    assert box.counts["skipped"] == 2


def test_newest_alone_is_per_stream_of_a_kind_and_its_field() -> None:
    box, me, mapping = Mailbox(ROBOTS), "navigator/robot_001", "robot-mapping/robot_001"
    for frame, is_global in enumerate([True, False, False, True, False]):
        grid = OccupancyGrid(frame, 0.0, 0.0, 1.0, is_global, np.zeros((2, 2), "u1"))
        _put(box, keys.SIM, me, mapping, grid, frame)
    assert [(e.message.stamp_ns, e.message.is_global) for e in box.take(9, newest_only=True)] == [(3, True), (4, False)]


NOTHING = np.zeros(0, "<u2")


@pytest.mark.parametrize(
    ("plane", "to", "sender", "message", "reason"),
    [
        (keys.RADIO, "robot-mapping/robot_001", "laser/robot_001", Scan(0, np.zeros((1, 8), "<u2")), "route"),
        (keys.SIM, "robot-mapping/robot_001", "laser/robot_002", Scan(0, np.zeros((1, 8), "<u2")), "route"),
        (keys.SIM, "robot-mapping/*", "laser/robot_001", Scan(0, np.zeros((1, 8), "<u2")), "route"),
        (keys.SIM, "robot-mapping/robot_001", "navigator/robot_002", Pose(0, *[0.0] * 7), "route"),
        (keys.RADIO, "navigator/robot_001", "map-manager", Mission(1, NOTHING, False), "route"),
        (keys.RADIO, "navigator/*", "orchestrator", Mission(1, NOTHING, False), "route"),
        (keys.RADIO, "map-manager", "robot-mapping/robot_003", Hello(bytes(16)), "robot"),
        (keys.RADIO, "map-manager", "robot-mapping", Hello(bytes(16)), "route"),
        (keys.RADIO, "map-manager", "robot-mapping/robot_0001", Hello(bytes(16)), "key"),
        (keys.SIM, "map-manager", "robot-mapping/robot_001", Hello(bytes(16)), "route"),
    ],
)
def test_what_comes_along_no_route_of_its_kind_is_refused(
    plane: str, to: str, sender: str, message: Message, reason: str
) -> None:
    box = Mailbox(ROBOTS)
    _put(box, plane, to, sender, message)
    assert box.counts == {f"rejected_{reason}": 1}
    assert box.take(9, newest_only=False) == [] and not box.bytes_received and box.lost == 0


NODES = ["world", "map-manager", "orchestrator", *(keys.node(s, r) for s in keys.ROBOT_SERVICES for r in ROBOTS)]


@given(
    st.sampled_from(sorted(KINDS)), st.sampled_from(keys.PLANES), st.sampled_from(NODES),
    st.sampled_from([*NODES, *map(keys.group, keys.ROBOT_SERVICES)]),
)  # fmt: skip
def test_exactly_what_the_book_allows_is_let_in(name: str, plane: str, sender: str, to: str) -> None:
    """The oracle is written apart, as a table of words."""
    (from_service, from_robot), (to_service, to_robot) = keys.split(sender), keys.split(to)
    table = {
        "Bodies": "sim world laser*", "Sensors": "sim world navigator", "Scan": "sim laser robot-mapping",
        "Pose": "sim navigator robot-mapping", "Drive": "sim navigator world",
        "OccupancyGrid": "sim robot-mapping navigator", "RunEnd": "sim orchestrator world",
        "Mission": "radio orchestrator navigator", "RobotStatus": "radio navigator orchestrator",
        "Phase": "radio orchestrator robot-mapping*", "MappingStatus": "radio robot-mapping orchestrator",
        "ManagerStatus": "radio map-manager orchestrator", "Digest": "radio map-manager robot-mapping*",
        "Delta": "radio map-manager robot-mapping robot-mapping*",
        **dict.fromkeys(("Hello", "Batch", "CellsRequest"), "radio robot-mapping map-manager"),
        **dict.fromkeys(("Welcome", "Fenced", "Ack"), "radio map-manager robot-mapping"),
    }  # fmt: skip
    its_plane, its_sender, *receivers = table[name].split()
    allowed = (plane, from_service) == (its_plane, its_sender) and (
        to_service + "*" * (to_robot == "*") in receivers and (not from_robot or to_robot in ("", from_robot))
    )
    box = Mailbox(ROBOTS)
    box.add(keys.message_key(plane, to, name, sender), wire.HEADER.pack(0, 0, 0, 2, 0))
    assert ("rejected_route" not in box.counts) == allowed


def test_nothing_longer_than_its_kind_can_be_is_collected() -> None:
    box = Mailbox(ROBOTS)
    key = keys.message_key(keys.RADIO, "robot-mapping/*", "Delta", "map-manager")
    box.add(key, wire.HEADER.pack(0, 0, 0, 3, 0) + bytes(9_000))
    assert box.counts == {"rejected_size": 1}
    longest = wire.encode(Delta(1, 0, 1, 0, 1, False, np.zeros(1024, CELL)))
    for piece in wire.fragments(0, 0, longest):
        box.add(key, piece)
    assert len(box.take(1, newest_only=False)) == 1


def test_bad_pieces_and_keys_are_counted_and_change_nothing() -> None:
    box = Mailbox(ROBOTS)
    box.add("og/sim/world/-/Drive/navigator/robot_001", b"short")
    box.add("og/nowhere", b"x" * 40)
    (piece,) = wire.fragments(0, 0, b"not msgpack")
    box.add("og/sim/world/-/Drive/navigator/robot_001", piece)
    assert box.counts == {"rejected_size": 1, "rejected_key": 1, "rejected_msgpack": 1, "forgotten": 0}
    assert box.take(9, newest_only=False) == []


def test_what_comes_twice_neither_counts_nor_is_delivered_twice(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(mailbox, "PATIENCE_S", 0.05)
    box, need = Mailbox(ROBOTS), {(keys.SIM, "world", "navigator/robot_001"): 2}
    for _ in range(2):
        _post(box, "navigator/robot_001", 7, 0)
    assert box.await_counted(7, need, STOP) == 1
    _post(box, "navigator/robot_001", 7, 1)
    assert box.await_counted(7, need, STOP) == 0
    assert [e.index for e in box.take(8, newest_only=False)] == [0, 1]
    _post(box, "navigator/robot_001", 7, 1)
    assert box.take(9, newest_only=False) == [] and box.counts["rejected_doubled"] == 2


def test_what_overflows_is_lost_although_it_had_arrived() -> None:
    box = Mailbox(ROBOTS, bound=3)
    for index in range(5):
        _post(box, "navigator/robot_001", 7, index)
    assert box.await_counted(7, {(keys.SIM, "world", "navigator/robot_001"): 5}, STOP) == 0
    assert [e.index for e in box.take(8, newest_only=False)] == [2, 3, 4]
    assert box.lost == box.counts["overflowed"] == 2


def test_what_waits_is_bounded_in_bytes() -> None:
    size = len(wire.encode(Drive(7, 0.0, 0.0)))
    box = Mailbox(ROBOTS, bound_bytes=3 * size)
    for index in range(5):
        _post(box, "navigator/robot_001", 7, index)
    assert [e.index for e in box.take(8, newest_only=False)] == [2, 3, 4] and box.lost == 2
    for index in range(3):
        _post(box, "navigator/robot_001", 8, index)
    assert len(box.take(9, newest_only=False)) == 3 and box.lost == 2


def test_what_says_that_it_is_of_a_far_future_does_not_stay() -> None:
    box = Mailbox(ROBOTS)
    for frame in (7, 7 + AHEAD_FRAMES_MAX, 8 + AHEAD_FRAMES_MAX, 2**32 - 1):
        _post(box, "navigator/robot_001", frame, 0)
    assert [e.frame for e in box.take(8, newest_only=False)] == [7]
    assert (box.waiting, box.counts["rejected_frame"], box.lost) == (1, 2, 2)
    assert [e.frame for e in box.take(8 + AHEAD_FRAMES_MAX, newest_only=False)] == [7 + AHEAD_FRAMES_MAX]


def test_a_flood_before_the_first_frame_stays_within_bounds() -> None:
    box = Mailbox(ROBOTS, bound=16)
    for frame in range(200):
        _post(box, "navigator/robot_001", frame, 0)
    assert box.waiting == len(box._arrived) == 16


def test_a_whole_message_that_cannot_be_read_is_lost_without_a_wait() -> None:
    box = Mailbox(ROBOTS)
    (piece,) = wire.fragments(7, 0, b"not msgpack")
    box.add("og/sim/world/-/Drive/navigator/robot_001", piece)
    assert box.await_counted(7, {(keys.SIM, "world", "navigator/robot_001"): 1}, STOP) == 0
    assert box.lost == 1


def test_senders_that_cannot_be_take_no_memory() -> None:
    box = Mailbox(ROBOTS)
    for i in range(1000):
        _post(box, f"navigator/nobody{i}", 7, 0)
    assert box.counts["rejected_key"] == 1000 and not box.bytes_received


def test_streams_are_a_nodes_own_and_its_groups() -> None:
    counted = {
        "sim/laser/all/world/-": 1, "sim/laser/robot_002/world/-": 2, "radio/map-manager/-/robot-mapping/robot_001": 3
    }  # fmt: skip
    assert streams_to(["laser/robot_001"], counted) == {("sim", "laser/*", "world"): 1}
    assert streams_to(["map-manager"], counted) == {("radio", "map-manager", "robot-mapping/robot_001"): 3}
