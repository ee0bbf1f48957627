"""The network of one process: what comes, when, how often and in which order, in calm and in bad weather."""

from __future__ import annotations

from collections import Counter

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from orograph import keys
from orograph.messages import Digest, Envelope, Fenced, Hello, ManagerStatus, Message, Scan
from orograph.runtime.network import CUT, Network, Spell, Weather
from orograph.scenario import RadioSpec, Scenario, Start

MAPPERS = [keys.node(keys.MAPPING, robot) for robot in ("robot_001", "robot_002")]
ONE, TWO = MAPPERS
ALL, MANAGER, ORCHESTRATOR = keys.group(keys.MAPPING), keys.MANAGER, keys.ORCHESTRATOR
NAMES = [MANAGER, ORCHESTRATOR, *MAPPERS]
LONG = 10_000
HELLO, FENCED = Hello(bytes(16)), Fenced(1)
SAYS: dict[tuple[str, str], Message] = {
    (MANAGER, ALL): Digest(1, 1, np.zeros((1, 16), "u1")),
    (MANAGER, ORCHESTRATOR): ManagerStatus(0, 1, bytes(16), 0, np.zeros(0, "<u2")),
    **{(MANAGER, robot): FENCED for robot in MAPPERS},
    **{(robot, MANAGER): HELLO for robot in MAPPERS},
}
LASER, OVER_WIRE = keys.node(keys.LASER, "robot_001"), Scan(0, np.zeros((1, 8), "<u2"))
CHANCES = st.floats(0, 1)
WEATHERS = st.builds(
    Weather, loss=CHANCES, duplication=CHANCES, delay=CHANCES, delay_frames_max=st.integers(1, 9), reordering=CHANCES
)


def network(*forecast: Spell, seed: int = 1, loss: float = 0.0, up: dict[str, bool] | None = None) -> Network:
    scenario = Scenario(
        name="flat", title="flat", starts=(Start(x_m=5, y_m=5), Start(x_m=15, y_m=5)), base_station_m=(5, 5),
        patrol=((20.0, 20.0),), robots=2, seed=seed, radio=RadioSpec(loss=loss),
    )  # fmt: skip
    return Network(scenario, NAMES, lambda: up or {}, forecast, lambda message: 10)


def envelope(frame: int, sender: str, to: str, index: int = 0, plane: str = keys.RADIO) -> Envelope:
    message = OVER_WIRE if plane == keys.SIM else SAYS[sender, to]
    return Envelope(plane, to, sender, frame, index, message)


def carry_for(frames: int, net: Network, sender: str = ONE, to: str = MANAGER, each: int = 1) -> list[list[Envelope]]:
    """What `to` gets frame by frame while `sender` sends in each of so many frames, and until all has come."""
    receiver, got = (TWO if to == ALL else to), []
    for frame in range(frames):
        net.carry(frame, [envelope(frame, sender, to, index) for index in range(each)])
        got.append(net.arrived(receiver, frame + 1))
    for frame in range(frames, net.last_due()):
        got.append(net.arrived(receiver, frame + 1))
    return got


def test_in_calm_weather_everything_comes_in_the_next_frame_once_and_in_order():
    net = network()
    sent = [envelope(0, MANAGER, ALL), envelope(0, MANAGER, ONE, 1), envelope(0, ONE, MANAGER)]
    net.carry(0, sent)
    assert net.arrived(ONE, 0) == []
    assert net.arrived(ONE, 1) == sent[:2] and net.arrived(TWO, 1) == sent[:1] and net.arrived(MANAGER, 1) == sent[2:]
    assert net.arrived(ONE, 2) == [] and net.last_due() == -1


def test_a_message_to_nobody_is_nobodys():
    net = network()
    net.carry(0, [Envelope(keys.RADIO, keys.node(keys.MAPPING, "robot_009"), MANAGER, 0, 0, FENCED)])
    assert net.last_due() == -1


def test_what_comes_along_no_route_of_its_kind_is_refused_and_counted():
    net = network()
    stranger = keys.node(keys.MAPPING, "robot_009")
    net.carry(0, [
        Envelope(keys.RADIO, ONE, ORCHESTRATOR, 0, 0, FENCED), Envelope(keys.SIM, ONE, MANAGER, 0, 0, FENCED),
        Envelope(keys.RADIO, ONE, MANAGER, 0, 0, HELLO), Envelope(keys.RADIO, MANAGER, stranger, 0, 0, HELLO),
    ])  # fmt: skip
    assert net.last_due() == -1 and net.refused == {"route": 3, "robot": 1} and not net.bytes_up


def test_the_wires_know_no_weather():
    net = network(Spell(CUT, 0, LONG), loss=1.0, up={"robot_001": False})
    net.carry(0, [envelope(0, LASER, ONE, plane=keys.SIM)])
    assert len(net.arrived(ONE, 1)) == 1


def test_a_robot_in_a_radio_shadow_neither_sends_nor_hears():
    up = {"robot_001": False}
    net = network(up=up)
    net.carry(0, [envelope(0, MANAGER, ALL), envelope(0, ONE, MANAGER)])
    assert not net.arrived(ONE, 1) and not net.arrived(MANAGER, 1) and len(net.arrived(TWO, 1)) == 1


@pytest.mark.parametrize(
    ("spell", "passes"),
    [
        (Spell(CUT, 0, 1), set()),
        (Spell(CUT, 0, 1, up=False), {(ONE, MANAGER), (TWO, MANAGER)}),
        (Spell(CUT, 0, 1, down=False), {(MANAGER, ONE), (MANAGER, TWO), (MANAGER, ORCHESTRATOR)}),
        (Spell(CUT, 0, 1, robots=("robot_001",)), {(TWO, MANAGER), (MANAGER, TWO), (MANAGER, ORCHESTRATOR)}),
        (
            Spell(CUT, 0, 1, robots=("robot_001",), up=False),
            {(ONE, MANAGER), (TWO, MANAGER), (MANAGER, TWO), (MANAGER, ORCHESTRATOR)},
        ),
    ],
    ids=["all", "down", "up", "one robot", "one robot down"],
)
def test_a_cut_lies_on_some_links_and_directions(spell, passes):
    net = network(spell)
    net.carry(0, [envelope(0, a, b) for a in (MANAGER, ONE, TWO) for b in (MANAGER, ORCHESTRATOR, ONE, TWO)
                  if (keys.MANAGER in (a, b)) and a != b])  # fmt: skip
    assert {(e.sender, name) for name in NAMES for e in net.arrived(name, 1)} == passes


def test_a_spell_has_a_beginning_and_an_end():
    got = carry_for(10, network(Spell(CUT, 3, 6)))
    assert [len(inbox) for inbox in got] == [1, 1, 1, 0, 0, 0, 1, 1, 1, 1]


def test_the_newest_spell_on_a_link_is_its_weather():
    storm = Spell(Weather(loss=1.0), 0, LONG)
    assert sum(map(len, carry_for(10, network(storm, Spell(Weather(), 2, 5, robots=("robot_001",)))))) == 3
    assert sum(map(len, carry_for(10, network(storm, Spell(Weather(), 2, 5, robots=("robot_002",)))))) == 0


@pytest.mark.parametrize("share", [0.1, 0.5])
def test_chances_are_met(share):
    """Of 4000 messages; five sigma of a share are at most 0.04."""
    n = 4000
    lost = n - sum(map(len, carry_for(n, network(Spell(Weather(loss=share), 0, LONG)))))
    doubled = sum(map(len, carry_for(n, network(Spell(Weather(duplication=share), 0, LONG))))) - n
    late = carry_for(n, network(Spell(Weather(delay=share, delay_frames_max=3), 0, LONG)))
    after = Counter(at - e.frame for at, inbox in enumerate(late) for e in inbox)
    assert lost / n == pytest.approx(share, abs=0.04) and doubled / n == pytest.approx(share, abs=0.04)
    assert sum(after.values()) == n and set(after) == {0, 1, 2, 3}
    assert 1 - after[0] / n == pytest.approx(share, abs=0.04)
    assert after[1] == pytest.approx(after[3], rel=0.5)


def test_what_overtakes_comes_first():
    (inbox,) = carry_for(1, network(Spell(Weather(reordering=1.0), 0, LONG)), each=5)
    assert [e.index for e in inbox] == [4, 3, 2, 1, 0]
    (some,) = carry_for(1, network(Spell(Weather(reordering=0.5), 0, LONG)), each=50)
    order = [e.index for e in some]
    assert sorted(order) == list(range(50)) != order
    turn = order.index(0)
    assert order[:turn] == sorted(order[:turn], reverse=True), "overtakers, the last in front"
    assert order[turn + 1 :] == sorted(order[turn + 1 :])


def test_the_scenarios_loss_comes_before_the_weather():
    through = sum(map(len, carry_for(1000, network(Spell(Weather(loss=0.5), 0, LONG), loss=0.5))))
    assert through / 1000 == pytest.approx(0.25, abs=0.07)


@settings(max_examples=30, deadline=None)
@given(WEATHERS, st.integers(0, 2**31 - 1), st.sampled_from([(ONE, MANAGER), (MANAGER, ALL), (MANAGER, ONE)]))
def test_whatever_the_weather_nothing_is_invented_or_early_and_a_seed_repeats(weather, seed, route):
    spell = Spell(weather, 0, LONG)
    got, again = (carry_for(30, network(spell, seed=seed), *route, each=3) for _ in range(2))
    times = Counter((e.frame, e.index) for inbox in got for e in inbox)
    assert (
        set(times) <= {(frame, index) for frame in range(30) for index in range(3)}
        and max(times.values(), default=0) <= 2
    )
    assert all(0 <= at - e.frame <= weather.delay_frames_max for at, inbox in enumerate(got) for e in inbox)
    assert [[(e.frame, e.index) for e in inbox] for inbox in got] == [
        [(e.frame, e.index) for e in inbox] for inbox in again
    ]


def test_bytes_are_weighed_by_robot_before_anything_is_lost():
    net = network(Spell(CUT, 0, LONG))
    net.carry(0, [envelope(0, MANAGER, ALL), envelope(0, ONE, MANAGER), envelope(0, MANAGER, ORCHESTRATOR),
                  envelope(0, LASER, ONE, plane=keys.SIM)])  # fmt: skip
    assert net.bytes_up == {"robot_001": 10} and net.bytes_down == {"robot_001": 10, "robot_002": 10}


@pytest.mark.parametrize("wrong", [{"loss": -0.1}, {"duplication": 1.1}, {"delay": 2}, {"delay_frames_max": 0}])
def test_impossible_weather_is_refused(wrong):
    with pytest.raises(AssertionError):
        Weather(**wrong)
