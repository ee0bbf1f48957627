"""The pace of paced time: kept on the average, and after a pause from there on."""

from itertools import pairwise

from hypothesis import given
from hypothesis import strategies as st
from orograph.runtime.clock import LATE_FRAMES_MAX, Pace

PERIOD_S = 0.1


def begins_s(steps_s: list[float]) -> list[float]:
    """When each frame begins, if each takes so long."""
    pace, now_s, begins = Pace(PERIOD_S, 0.0), 0.0, [0.0]
    for step_s in steps_s:
        now_s += step_s
        now_s += pace.wait_s(now_s)
        begins.append(now_s)
    return begins


@given(st.lists(st.floats(0.0, LATE_FRAMES_MAX * PERIOD_S), min_size=1, max_size=5))
def test_a_short_delay_is_made_good(delays_s: list[float]) -> None:
    steps_s = [step for delay_s in delays_s for step in (delay_s, *[0.0] * (LATE_FRAMES_MAX + 1))]
    assert abs(begins_s(steps_s)[-1] - len(steps_s) * PERIOD_S) < 1e-9


@given(st.floats(LATE_FRAMES_MAX * PERIOD_S + 0.2, 1e4))
def test_after_a_pause_no_frame_is_hurried(pause_s: float) -> None:
    begins = begins_s([0.0, 0.0, pause_s, *[0.0] * 10])
    gaps = [b - a for a, b in pairwise(begins[3:])]
    assert min(gaps) > PERIOD_S * 0.999


def test_lockstep_never_waits() -> None:
    pace = Pace(0.0, 5.0)
    assert [pace.wait_s(now_s) for now_s in (5.0, 5.1, 7.0)] == [0.0, 0.0, 0.0]
