"""The barrier knows whether the same participants kept step from the first tick on."""

from collections.abc import Callable

import pytest
from orograph.comms import wire
from orograph.control import INSTANCES_MAX, Answer, Tick
from orograph.kinds import Rejected
from orograph.runtime.barrier import Barrier


class Wire:
    """Stands in for the sim plane: tests call what the barrier has declared."""

    def watch_alive(self, callback: Callable[[str, str, tuple[str, ...], bool], None]) -> None:
        self.token = lambda instance, alive: callback("laser", instance, (), alive)

    def hear(self, key: str, kind: type[Answer], callback: Callable[[Answer], None]) -> None:
        self.answer = callback

    def tell(self, key: str, tick: Tick) -> None:
        self.told = tick

    def join(self, instance: str) -> None:
        self.token(instance, True)
        self.answer(Answer(instance, (instance,), -1, {}, 0))


@pytest.fixture
def bus() -> Wire:
    return Wire()


@pytest.fixture
def barrier(bus: Wire) -> Barrier:
    """Of `a` and `b`, before the first tick."""
    barrier = Barrier(bus)
    bus.join("a")
    bus.join("b")
    return barrier


def test_who_comes_and_goes_before_the_first_tick_is_no_matter(bus: Wire, barrier: Barrier) -> None:
    bus.token("a", False)
    bus.join("c")
    for frame in range(3):
        assert barrier.tick(frame, {}) == ["b", "c"]
    assert barrier.steady


@pytest.mark.parametrize("event", [
    lambda bus: bus.token("a", False),
    lambda bus: (bus.token("a", False), bus.join("a")),
    lambda bus: (bus.token("a", False), bus.join("c")),
    lambda bus: bus.join("c"),
], ids=["left", "back at once", "replaced", "late"])  # fmt: skip
def test_any_change_after_it_is_remembered(bus: Wire, barrier: Barrier, event: Callable[[Wire], object]) -> None:
    barrier.tick(0, {})
    event(bus)
    barrier.tick(1, {})
    assert not barrier.steady


def test_a_crowd_cannot_make_a_tick_that_cannot_be_carried(bus: Wire, barrier: Barrier) -> None:
    for i in range(INSTANCES_MAX - 2):
        bus.join(f"crowd-{i}")
    with pytest.raises(Rejected, match="full"):
        bus.join("one-more")
    bus.join("a")
    assert len(barrier.tick(0)) == INSTANCES_MAX
    wire.encode(bus.told)
