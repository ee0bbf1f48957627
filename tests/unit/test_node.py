"""A beat comes once a period whatever frames a node steps."""

from hypothesis import given
from hypothesis import strategies as st
from orograph.node import Every


@given(st.lists(st.integers(1, 400), max_size=60), st.integers(1, 300))
def test_every_period_in_which_a_frame_came_has_one_beat_in_its_first_frame(gaps: list[int], period_ns: int) -> None:
    every, now_ns, beaten = Every(period_ns), 0, set()
    for gap in [0, *gaps]:
        now_ns += gap
        assert every.due(now_ns) == (now_ns // period_ns not in beaten)
        beaten.add(now_ns // period_ns)


def test_who_starts_in_the_middle_beats_at_once_and_then_with_the_others() -> None:
    every = Every(10)
    assert [now for now in range(57, 85, 3) if every.due(now)] == [57, 60, 72, 81]
