"""The mailbox: counted messages are awaited, lost ones are named, order never depends on arrival."""

import threading
import time

import numpy as np
import pytest
from orograph import keys
from orograph.comms import mailbox, wire
from orograph.comms.mailbox import AHEAD_FRAMES_MAX, CUT_PATIENCE_S, Mailbox, routes_to
from orograph.messages import POSE, Bodies, Drive

STOP = threading.Event()


def _post(box: Mailbox, sender: str, frame: int, index: int, to: str = "world", plane: str = keys.SIM) -> None:
    for piece in wire.fragments(frame, index, wire.encode(Drive(frame, float(index), 0.0))):
        box.add(keys.message_key(plane, to, "Drive", sender), piece)


def test_messages_come_out_by_sender_and_index_whatever_the_arrival() -> None:
    box = Mailbox()
    for sender, index in [("navigator/robot_002", 0), ("navigator/robot_001", 1), ("navigator/robot_001", 0)]:
        _post(box, sender, 4, index)
    taken = [(e.sender, e.index) for e in box.take(5, newest_only=False)]
    assert taken == [("navigator/robot_001", 0), ("navigator/robot_001", 1), ("navigator/robot_002", 0)]
    assert box.take(5, newest_only=False) == []


def test_a_message_of_this_frame_waits_for_the_next() -> None:
    box = Mailbox()
    _post(box, "navigator/robot_001", 5, 0)
    assert box.take(5, newest_only=False) == []
    assert len(box.take(6, newest_only=False)) == 1


def test_a_counted_message_is_awaited() -> None:
    box = Mailbox()
    threading.Timer(0.05, _post, (box, "navigator/robot_001", 7, 0)).start()
    assert box.await_counted(7, {(keys.SIM, "world", "navigator/robot_001"): 1}, STOP) == 0


def test_a_lost_message_is_given_up_once_and_the_plane_is_then_not_trusted() -> None:
    box = Mailbox()
    box_patience = {(keys.RADIO, "map-manager", "robot-mapping/robot_001"): 2}
    _post(box, "robot-mapping/robot_001", 1, 0, "map-manager", keys.RADIO)
    assert box.await_counted(1, box_patience, STOP) == 1
    begin = time.monotonic()
    assert box.await_counted(2, box_patience, STOP) == 2
    assert time.monotonic() - begin < 20 * CUT_PATIENCE_S
    assert box.counts["lost"] == 3


def test_a_stream_late_in_paced_time_keeps_its_newest_and_counts_the_rest() -> None:
    box = Mailbox()
    for frame in range(3):
        for piece in wire.fragments(frame, 0, wire.encode(Bodies(frame, np.zeros(1, POSE)))):
            box.add(keys.message_key(keys.SIM, "laser/*", "Bodies", "world"), piece)
        _post(box, "navigator/robot_001", frame, 0)
    taken = box.take(3, newest_only=True)
    assert [e.message.stamp_ns for e in taken if isinstance(e.message, Bodies)] == [2]
    assert sum(isinstance(e.message, Drive) for e in taken) == 3
    assert box.counts["skipped"] == 2


def test_bad_pieces_and_keys_are_counted_and_change_nothing() -> None:
    box = Mailbox()
    box.add("og/sim/world/-/Drive/navigator/robot_001", b"short")
    box.add("og/nowhere", b"x" * 40)
    (piece,) = wire.fragments(0, 0, b"not msgpack")
    box.add("og/sim/world/-/Drive/navigator/robot_001", piece)
    assert box.counts == {"rejected_size": 1, "rejected_key": 1, "rejected_msgpack": 1, "forgotten": 0}
    assert box.take(9, newest_only=False) == []


def test_what_comes_twice_neither_counts_nor_is_delivered_twice(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(mailbox, "PATIENCE_S", 0.05)
    box, need = Mailbox(), {(keys.SIM, "world", "navigator/robot_001"): 2}
    for _ in range(2):
        _post(box, "navigator/robot_001", 7, 0)
    assert box.await_counted(7, need, STOP) == 1
    _post(box, "navigator/robot_001", 7, 1)
    assert box.await_counted(7, need, STOP) == 0
    assert [e.index for e in box.take(8, newest_only=False)] == [0, 1]
    _post(box, "navigator/robot_001", 7, 1)
    assert box.take(9, newest_only=False) == [] and box.counts["rejected_doubled"] == 2


def test_what_overflows_is_lost_although_it_had_arrived() -> None:
    box = Mailbox(bound=3)
    for index in range(5):
        _post(box, "navigator/robot_001", 7, index)
    assert box.await_counted(7, {(keys.SIM, "world", "navigator/robot_001"): 5}, STOP) == 0
    assert [e.index for e in box.take(8, newest_only=False)] == [2, 3, 4]
    assert box.lost == box.counts["overflowed"] == 2


def test_what_waits_is_bounded_in_bytes() -> None:
    size = len(wire.encode(Drive(7, 0.0, 0.0)))
    box = Mailbox(bound_bytes=3 * size)
    for index in range(5):
        _post(box, "navigator/robot_001", 7, index)
    assert [e.index for e in box.take(8, newest_only=False)] == [2, 3, 4] and box.lost == 2
    for index in range(3):
        _post(box, "navigator/robot_001", 8, index)
    assert len(box.take(9, newest_only=False)) == 3 and box.lost == 2


def test_what_says_that_it_is_of_a_far_future_does_not_stay() -> None:
    box = Mailbox()
    for frame in (7, 7 + AHEAD_FRAMES_MAX, 8 + AHEAD_FRAMES_MAX, 2**32 - 1):
        _post(box, "navigator/robot_001", frame, 0)
    assert [e.frame for e in box.take(8, newest_only=False)] == [7]
    assert (box.waiting, box.counts["rejected_frame"], box.lost) == (1, 2, 2)
    assert [e.frame for e in box.take(8 + AHEAD_FRAMES_MAX, newest_only=False)] == [7 + AHEAD_FRAMES_MAX]


def test_a_flood_before_the_first_frame_stays_within_bounds() -> None:
    box = Mailbox(bound=16)
    for frame in range(200):
        _post(box, "navigator/robot_001", frame, 0)
    assert box.waiting == len(box._arrived) == 16


def test_a_whole_message_that_cannot_be_read_is_lost_without_a_wait() -> None:
    box = Mailbox()
    (piece,) = wire.fragments(7, 0, b"not msgpack")
    box.add("og/sim/world/-/Drive/navigator/robot_001", piece)
    assert box.await_counted(7, {(keys.SIM, "world", "navigator/robot_001"): 1}, STOP) == 0
    assert box.lost == 1


def test_senders_that_cannot_be_take_no_memory() -> None:
    box = Mailbox()
    for i in range(1000):
        _post(box, f"navigator/nobody{i}", 7, 0)
    assert box.counts["rejected_key"] == 1000 and not box.bytes_received


def test_routes_are_a_nodes_own_and_its_groups() -> None:
    table = {"sim": {"laser/*": {"world": 1}, "laser/robot_002": {"world": 2}}, "radio": {"map-manager": {"x": 3}}}
    assert routes_to(["laser/robot_001"], table) == {("sim", "laser/*", "world"): 1}
    assert routes_to(["map-manager"], table) == {("radio", "map-manager", "x"): 3}
