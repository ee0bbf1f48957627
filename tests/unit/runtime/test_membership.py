"""Claims and leases: one holder per robot and service, whatever comes in whatever order."""

from __future__ import annotations

from hypothesis import settings
from hypothesis import strategies as st
from hypothesis.stateful import Bundle, RuleBasedStateMachine, invariant, rule
from orograph import keys
from orograph.runtime.membership import Grant, Membership

ROBOTS = ("robot_001", "robot_002", "robot_003")
LASER, MAPPING, NAVIGATOR = keys.ROBOT_SERVICES


def test_the_same_instance_gets_the_same_robots_again() -> None:
    table = Membership(ROBOTS)
    assert table.claim(LASER, "a", 1) == Grant(("robot_001",), "")
    assert table.claim(LASER, "b", 1) == Grant(("robot_002",), "")
    assert table.claim(LASER, "a", 3) == Grant(("robot_001",), "")


def test_a_robot_that_has_its_mapping_is_filled_first() -> None:
    table = Membership(ROBOTS)
    table.restore([(MAPPING, "m", ("robot_003",)), (NAVIGATOR, "n", ("robot_002",))])
    assert table.claim(LASER, "a", 1).robots == ("robot_003",)
    assert table.claim(LASER, "b", 1).robots == ("robot_002",)


def test_after_a_fleet_has_shrunk_its_workers_regroup_round_the_evidence() -> None:
    table = Membership(ROBOTS)
    held = {MAPPING: {"m1": "robot_001", "m3": "robot_003"}, LASER: {"l1": "robot_001", "l2": "robot_002"}}
    held[NAVIGATOR] = {"n2": "robot_002", "n3": "robot_003"}
    table.restore([(s, i, (robot,)) for s, of in held.items() for i, robot in of.items()])
    assert table.strays() == ((LASER, "l2"), (NAVIGATOR, "n2"))
    for service, instance in table.strays():
        table.lost(service, instance)
        table.claim(service, f"{instance} again", 1)
    assert table.complete() == ("robot_001", "robot_003") and table.strays() == ()


def test_a_whole_fleet_and_a_lone_gap_have_no_strays() -> None:
    table = Membership(ROBOTS)
    for service in keys.ROBOT_SERVICES:
        table.claim(service, service, 3)
    assert table.strays() == ()
    table.lost(LASER, LASER)
    assert table.strays() == ()


def test_a_full_fleet_says_so_and_a_spare_takes_over() -> None:
    table = Membership(ROBOTS)
    assert table.claim(MAPPING, "a", 3).robots == ROBOTS
    refused = table.claim(MAPPING, "spare", 1)
    assert refused.robots == () and "spare" in refused.reason and "3 robots" in refused.reason
    table.lost(MAPPING, "a")
    assert table.claim(MAPPING, "spare", 1) == Grant(("robot_001",), "")


def test_a_revoked_robot_is_given_to_nobody_again() -> None:
    table = Membership(ROBOTS)
    assert table.claim(LASER, "a", 3, revoked={"robot_002"}).robots == ("robot_001", "robot_003")
    assert table.claim(MAPPING, "b", 1, ("robot_002",), {"robot_002"}) == Grant(
        (), "robot_002: revoked; wait as a spare"
    )
    assert not table.claim(NAVIGATOR, "c", 3, revoked=ROBOTS).robots


def test_an_instance_that_comes_back_finds_its_own_robot() -> None:
    table = Membership(ROBOTS)
    table.claim(LASER, "a", 1)
    table.claim(LASER, "b", 1)
    table.lost(LASER, "a")
    table.lost(LASER, "b")
    assert table.claim(LASER, "b", 1) == Grant(("robot_002",), "")


def test_a_wanted_robot_is_given_or_refused_by_name() -> None:
    table = Membership(ROBOTS)
    assert table.claim(LASER, "a", 2, ("robot_003", "robot_003", "robot_002")).robots == ("robot_002", "robot_003")
    assert "robot_003" in table.claim(LASER, "b", 1, ("robot_003",)).reason
    assert "robot_009" in table.claim(LASER, "b", 1, ("robot_009",)).reason
    assert table.claim(LASER, "b", 1, ("robot_001",)) == Grant(("robot_001",), "")


def test_a_restarted_orchestrator_gives_nothing_twice() -> None:
    table = Membership(ROBOTS)
    tokens = [(LASER, "a", ("robot_002",)), (keys.WORLD, "w", ()), (LASER, "z", ("robot_002", "robot_777"))]
    table.restore(tokens)
    assert table.claim(LASER, "b", 3).robots == ("robot_001", "robot_003")
    assert table.claim(LASER, "a", 1) == Grant(("robot_002",), "")
    assert table.held(LASER, "z") == ()


def test_complete_needs_every_service() -> None:
    table = Membership(ROBOTS)
    table.claim(LASER, "a", 3)
    table.claim(MAPPING, "b", 2)
    table.claim(NAVIGATOR, "c", 1, ("robot_002",))
    assert table.complete() == ("robot_002",)
    table.lost(MAPPING, "b")
    assert table.complete() == ()


class Leases(RuleBasedStateMachine):
    """Any order of claims, deaths and orchestrator restarts; the oracle is who believes to hold what."""

    instances = Bundle("instances")

    def __init__(self) -> None:
        super().__init__()
        self.table = Membership(ROBOTS)
        self.believed: dict[tuple[str, str], tuple[str, ...]] = {}
        self.born = 0

    @rule(target=instances, service=st.sampled_from(keys.ROBOT_SERVICES))
    def is_born(self, service: str) -> tuple[str, str]:
        self.born += 1
        return service, f"instance-{self.born}"

    @rule(who=instances, capacity=st.integers(1, 3), wanted=st.lists(st.sampled_from(ROBOTS), max_size=2))
    def claims(self, who: tuple[str, str], capacity: int, wanted: list[str]) -> None:
        service = who[0]
        taken = {r for (s, _), robots in self.believed.items() if s == service for r in robots}
        free = set(wanted or ROBOTS) - taken
        grant = self.table.claim(*who, capacity, tuple(wanted))
        if who in self.believed:
            assert grant.robots == self.believed[who]
            return
        assert set(grant.robots) <= free and len(grant.robots) == min(capacity, len(free))
        assert bool(grant.robots) != bool(grant.reason)
        if grant.robots:
            self.believed[who] = grant.robots

    @rule(who=instances)
    def dies(self, who: tuple[str, str]) -> None:
        self.table.lost(*who)
        self.believed.pop(who, None)

    @rule(backwards=st.booleans())
    def orchestrator_restarts(self, backwards: bool) -> None:
        tokens = [(service, instance, robots) for (service, instance), robots in self.believed.items()]
        self.table = Membership(ROBOTS)
        self.table.restore(reversed(tokens) if backwards else tokens)

    @invariant()
    def nothing_is_held_twice(self) -> None:
        for service in keys.ROBOT_SERVICES:
            held = [r for (s, _), robots in self.believed.items() if s == service for r in robots]
            assert len(held) == len(set(held)), self.believed
        for (service, instance), robots in self.believed.items():
            assert self.table.held(service, instance) == robots

    @invariant()
    def complete_is_what_all_three_hold(self) -> None:
        pairs = {(s, r) for (s, _), robots in self.believed.items() for r in robots}
        assert self.table.complete() == tuple(r for r in ROBOTS if all((s, r) in pairs for s in keys.ROBOT_SERVICES))


Leases.TestCase.settings = settings(max_examples=60, stateful_step_count=25, deadline=None)
TestLeases = Leases.TestCase


def test_it_says_who_holds_what() -> None:
    table = Membership(("robot_001", "robot_002"))
    table.claim("laser", "a", 2)
    table.claim("navigator", "b", 1)
    assert table.holders() == {"robot_001": {"laser": "a", "navigator": "b"}, "robot_002": {"laser": "a"}}
    table.lost("laser", "a")
    assert table.holders() == {"robot_001": {"navigator": "b"}, "robot_002": {}}
