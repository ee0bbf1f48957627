"""Claims over a real router: no robot is held twice, the dead give theirs back, a proven holder keeps its own."""

import threading
import time
from concurrent.futures import ThreadPoolExecutor

import pytest
from contract import claimant
from orograph import keys
from orograph.comms.bus import Bus
from orograph.control import Release, Tick
from orograph.runtime import claims
from polling import until

ROBOTS = tuple(keys.robot_id(i + 1) for i in range(5))
STOP = threading.Event()


def _ask(bus: Bus, instance: str, service: str = keys.LASER, capacity: int = 1) -> list[str]:
    """The robots granted; asked again, as a worker does, until the routers know the one who answers."""

    def answer() -> tuple[list[str], ...]:
        robots = claimant.ask(bus, instance, service, capacity)
        return () if robots is None else (robots,)

    return until(answer, "nobody answers", within_s=10)[0]


def test_claims_made_at_once_are_disjoint_and_the_rest_are_spares(endpoint: str) -> None:
    with Bus.open(endpoint, None, STOP) as server, Bus.open(endpoint, None, STOP) as bus:
        claims.Claims(ROBOTS, lambda fleet: None).attend(server)
        with ThreadPoolExecutor(8) as pool:
            grants = list(pool.map(lambda i: _ask(bus, f"i{i}"), range(8)))
    assert sorted(r for g in grants for r in g) == sorted(ROBOTS)
    assert sum(not g for g in grants) == 3


def test_the_dead_give_back_and_the_proven_keep(endpoint: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(claims, "UNPROVEN_S", 0.2)
    with Bus.open(endpoint, None, STOP) as server, Bus.open(endpoint, None, STOP) as bus:
        claims.Claims(ROBOTS[:1], lambda fleet: None).attend(server)
        assert _ask(bus, "silent") == ["robot_001"]
        assert _ask(bus, "other") == []
        until(lambda: _ask(bus, "other") == ["robot_001"], "the other gets none", within_s=10)
        token = bus.token(keys.LASER, "other", ("robot_001",))
        until(lambda: _ask(bus, "other") == ["robot_001"], "the other gets none", within_s=10)
        for _ in range(40):
            assert _ask(bus, "late") == []
            time.sleep(0.01)
        token.undeclare()
        until(lambda: _ask(bus, "late") == ["robot_001"], "the late one gets none", within_s=10)


def test_a_new_orchestrator_learns_who_holds_what(endpoint: str) -> None:
    with Bus.open(endpoint, None, STOP) as bus, Bus.open(endpoint, None, STOP) as server:
        token = bus.token(keys.LASER, "old", ("robot_001", "robot_002"))
        claims.Claims(ROBOTS[:3], lambda fleet: None).attend(server)
        assert _ask(bus, "new", capacity=3) == ["robot_003"]
        token.undeclare()


def test_the_fleet_is_told_of_once_it_was_whole(endpoint: str) -> None:
    told: list[tuple[str, ...]] = []
    with Bus.open(endpoint, None, STOP) as server, Bus.open(endpoint, None, STOP) as bus:
        claims.Claims(ROBOTS[:2], told.append).attend(server)
        tokens = [bus.token(s, f"{s}{r}", (r,)) for s in keys.ROBOT_SERVICES for r in ROBOTS[:2]]
        until(lambda: bool(told), "the fleet is not told of", within_s=10)
        assert told == [ROBOTS[:2]]
        tokens[0].undeclare()
        until(lambda: len(told) == 2, "the loss is not told of", within_s=10)
        assert told[1] == ("robot_002",)


def test_a_worker_that_another_robot_needs_is_released(endpoint: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(claims, "REGROUP_S", 0.2)
    monkeypatch.setattr(claims, "REVIEW_EVERY_S", 0.0)
    released: list[str] = []
    with Bus.open(endpoint, None, STOP) as server, Bus.open(endpoint, None, STOP) as bus:
        claims.Claims(ROBOTS[:2], lambda fleet: None).attend(server)
        holds = {keys.MAPPING: ROBOTS[0], keys.NAVIGATOR: ROBOTS[0], keys.LASER: ROBOTS[1]}
        tokens = [bus.token(service, f"worker-{service}", (robot,)) for service, robot in holds.items()]
        for service in holds:
            bus.hear(keys.release_key(f"worker-{service}"), Release, lambda _, s=service: released.append(s))

        def ticked() -> bool:
            bus.tell(keys.TICK, Tick(0, True, False, {}, (), ()))
            return bool(released)

        until(ticked, "nobody is released", within_s=10)
        assert set(released) == {keys.LASER}
        for token in tokens:
            token.undeclare()
