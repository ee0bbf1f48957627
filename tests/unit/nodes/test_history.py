"""Histories: every row while there is room, thinned out alike and bounded for any length of run."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from orograph.nodes import navigator, world
from orograph.nodes.history import History

FRAME_NS = 100_000_000
DAY = 24 * 36_000


@given(st.integers(2, 60), st.sets(st.integers(0, 400)))
def test_keeps_the_frames_of_one_power_of_two_and_at_least_half_of_what_there_is_room_for(room, frames):
    history = History(2, FRAME_NS, 16 * room)
    for frame in sorted(frames):
        history.append(frame * FRAME_NS, float(frame))
        kept = set(history.rows()[:, 1].tolist())
        seen = {f for f in frames if f <= frame}
        fitting = [s for s in range(10) if len({f for f in seen if f % 2**s == 0}) <= room]
        assert kept == {f for f in seen if f % 2 ** fitting[0] == 0}
        assert history.nbytes <= 16 * room
    np.testing.assert_array_equal(history.rows()[:, 0], history.rows()[:, 1] * FRAME_NS)


def test_a_day_of_a_hundred_robots_stays_within_its_bytes():
    columns = 1 + 100 * len(world.ROBOT_COLUMNS) + 20 * len(world.VEHICLE_COLUMNS)
    bodies = History(columns, FRAME_NS, world.HISTORY_BYTES)
    row = np.zeros(columns - 1).tolist()
    one = History(6, FRAME_NS, navigator.HISTORY_BYTES)
    for frame in (*range(30_000), *range(30_000, DAY, 16)):  # every frame at first, then for this test's time a few
        one.append(frame * FRAME_NS, 1.0, 2.0, 3.0, 4.0, 5.0)
        bodies.append(frame * FRAME_NS, *row)
        assert bodies.nbytes <= world.HISTORY_BYTES and one.nbytes <= navigator.HISTORY_BYTES
    assert world.HISTORY_BYTES == 64 * 2**20 and navigator.HISTORY_BYTES == 2 * 2**20
    assert len(bodies.rows()) > 6_500 and bodies.rows()[-1, 0] > 0.999 * DAY * FRAME_NS
    assert len(one.rows()) > 20_000
