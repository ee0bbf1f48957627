"""One router per host, linked to each other: who is on one sees who is on the other, also after the link was cut."""

from __future__ import annotations

import sys
import threading
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import pytest
from contract import claimant
from contract.chatter import (
    LASER,
    MAPPING,
    NAVIGATOR,
    Stop,
    assert_steps_as_one_process,
    await_progress,
    make_chatters,
    make_clock,
    participate,
)
from contract.conftest import free_endpoint
from contract.link import Link
from orograph import keys
from orograph.comms.bus import Bus
from orograph.control import Release
from orograph.runtime.claims import Claims
from orograph.storage.recording import Recording
from polling import until

STOP = threading.Event()
FAR = NAVIGATOR


@dataclass
class Hosts:
    """Two routers and the link between them."""

    base: str
    far: str
    link: Link


@pytest.fixture
def hosts(start_router: Callable[..., object]) -> Iterator[Hosts]:
    base, far = free_endpoint(), free_endpoint()
    with Link(int(base.rsplit(":", 1)[1])) as link:
        start_router(far, link.endpoint)
        start_router(base)
        yield Hosts(base, far, link)


def claim(bus: Bus, instance: str) -> list[str]:
    return claimant.ask(bus, instance) or []


class Tokens:
    """Who lives, as one bus sees it."""

    def __init__(self, bus: Bus) -> None:
        self.alive: set[str] = set()
        bus.watch_alive(self._on_token)

    def _on_token(self, service: str, instance: str, robots: tuple[str, ...], alive: bool) -> None:
        (self.alive.add if alive else self.alive.discard)(instance)


def test_queries_tokens_and_messages_cross_the_link_both_ways(hosts: Hosts) -> None:
    with Bus.open(hosts.base, None, STOP) as base, Bus.open(hosts.far, None, STOP) as far:
        near, there = Tokens(base), Tokens(far)
        Claims(("robot_001",), lambda fleet: None).attend(base)
        until(lambda: claim(far, "far") == ["robot_001"], "no answer over the link")
        with far.token(keys.LASER, "far", ("robot_001",)), base.token(keys.WORLD, "base", ()):
            until(lambda: near.alive >= {"far"} and there.alive >= {"base"}, "tokens do not cross the link")
        until(lambda: not near.alive & {"far"} and not there.alive & {"base"}, "tokens stay when they should go")
        heard: set[str] = set()
        base.hear("og/release/base", Release, lambda _: heard.add("base"))
        far.hear("og/release/far", Release, lambda _: heard.add("far"))

        def both() -> bool:
            far.tell("og/release/base", Release())
            base.tell("og/release/far", Release())
            return heard == {"base", "far"}

        until(both, "messages do not cross the link")


def test_without_the_link_nobody_is_seen(start_router: Callable[..., object]) -> None:
    """The checker of the test above: two routers that are not linked share nothing."""
    endpoints = free_endpoint(), free_endpoint()
    for endpoint in endpoints:
        start_router(endpoint)
    with Bus.open(endpoints[0], None, STOP) as one, Bus.open(endpoints[1], None, STOP) as other:
        Claims(("robot_001",), lambda fleet: None).attend(one)
        assert claim(one, "near") == ["robot_001"] and claim(other, "far") == []


def test_lockstep_over_two_routers_is_that_of_one_process(hosts: Hosts, tmp_path: Path) -> None:
    near = dict.fromkeys((keys.WORLD, LASER), hosts.base)
    assert_steps_as_one_process(near | dict.fromkeys((MAPPING, FAR), hosts.far), tmp_path)


@pytest.mark.parametrize("cut", [Link.reset, Link.fall_silent])
def test_a_cut_link_is_seen_on_both_sides_and_heals(hosts: Hosts, cut: Callable[[Link], None]) -> None:
    fleets: list[tuple[str, ...]] = []
    with Bus.open(hosts.base, None, STOP) as base, Bus.open(hosts.far, None, STOP) as far:
        near, there = Tokens(base), Tokens(far)
        Claims(("robot_001", "robot_002"), fleets.append, start_with=1).attend(base)
        until(lambda: claim(far, "laser") == ["robot_001"], "no answer over the link")
        with far.token(keys.LASER, "laser", ("robot_001",)), base.token(keys.WORLD, "base", ()):
            others = [s for s in keys.ROBOT_SERVICES if s != keys.LASER]
            tokens = [base.token(service, f"near-{service}", ("robot_001",)) for service in others]
            until(lambda: fleets and fleets[-1] == ("robot_001",), "the robot is not whole")
            until(lambda: "base" in there.alive, "the far host does not see the base")
            cut(hosts.link)
            until(lambda: "laser" not in near.alive and "base" not in there.alive, "the cut is not seen")
            until(lambda: fleets[-1] == (), "the robot still counts as whole")
            hosts.link.heal()
            until(lambda: "laser" in near.alive and "base" in there.alive, "the link does not come back")
            until(lambda: fleets[-1] == ("robot_001",), "the robot is not whole again")
            assert claim(far, "laser") == ["robot_001"] and claim(far, "spare") == ["robot_002"]
            assert len(tokens) == 2


@pytest.mark.parametrize("cut", [Link.reset, Link.fall_silent])
def test_the_clock_goes_on_while_the_far_host_is_away_and_with_it_afterwards(
    hosts: Hosts, cut: Callable[[Link], None], tmp_path: Path
) -> None:
    watchdog, chatters = Stop(), make_chatters()
    near, far = chatters[LASER], chatters[FAR]
    chatters[keys.WORLD].goal = sys.maxsize
    threads = [participate(hosts.base, near, watchdog, tmp_path), participate(hosts.far, far, watchdog, tmp_path)]
    with Recording(tmp_path, "world") as recording, Bus.open(hosts.base, None, watchdog.stop) as bus:
        clock = make_clock(bus, chatters[keys.WORLD], watchdog, recording, [LASER, FAR])
        tokens = Tokens(bus)
        clock.await_start()
        ticking = threading.Thread(target=clock.run, daemon=True)
        ticking.start()
        await_progress(far)
        cut(hosts.link)
        until(lambda: FAR.replace("/", "-") not in tokens.alive, "the cut is not seen")
        before = far.frames
        await_progress(near)
        assert far.frames == before
        hosts.link.heal()
        await_progress(far)
        await_progress(near)
        watchdog.stop.set()
        ticking.join(20)
        assert not ticking.is_alive()
    for thread in threads:
        thread.join(10)
        assert not thread.is_alive()
    assert not clock.deterministic
