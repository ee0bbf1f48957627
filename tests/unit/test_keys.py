"""Keys: one builder, and a parser that takes nothing else."""

import re

import pytest
from hypothesis import given
from hypothesis import strategies as st
from orograph import keys

NODES = [
    keys.node(s, r)
    for s in keys.SERVICES
    for r in ([None] if s not in keys.ROBOT_SERVICES else ["robot_001", "robot_999"])
]


@given(st.sampled_from(keys.PLANES), st.sampled_from([*NODES, "laser/*"]), st.sampled_from(NODES))
def test_a_message_key_comes_back(plane: str, to: str, sender: str) -> None:
    key = keys.message_key(plane, to, "Scan", sender)
    assert keys.parse_message_key(key) == (plane, to, "Scan", sender)


@pytest.mark.parametrize("key", ["", "og", "og/sim/world/-/Drive/navigator", "xx/sim/world/-/Drive/world/-",
                                 "og/air/world/-/Drive/world/-", "og/sim/moon/-/Drive/world/-",
                                 "og/sim/laser/anybody/Drive/world/-", "og/sim/world/-/Drive/laser/all"])  # fmt: skip
def test_other_keys_are_refused(key: str) -> None:
    with pytest.raises(ValueError, match="key"):
        keys.parse_message_key(key)


def test_robot_ids_by_hand() -> None:
    assert keys.robot_id(7) == "robot_007"
    assert keys.robot_number("robot_120") == 120
    for bad in ("robot_1", "robot_0001", "world", "robot_abc"):
        with pytest.raises(ValueError, match="robot id"):
            keys.robot_number(bad)
    with pytest.raises(ValueError, match=r"1\.\.999"):
        keys.robot_id(0)


def test_a_robots_node_hears_its_own_key_and_its_groups() -> None:
    assert keys.inbox_keys("radio", "navigator/robot_002") == [
        "og/radio/navigator/robot_002/**",
        "og/radio/navigator/all/**",
    ]
    assert keys.inbox_keys("sim", "world") == ["og/sim/world/-/**"]


@given(st.lists(st.sampled_from(["robot_001", "robot_002"]), unique=True).map(tuple))
def test_liveliness_keys_come_back(robots: tuple[str, ...]) -> None:
    assert keys.parse_alive_key(keys.alive_key("laser", "abc", robots)) == ("laser", "abc", robots)


@given(st.sampled_from(keys.PLANES), st.sampled_from([*NODES, "laser/*"]), st.sampled_from(NODES))
def test_a_streams_name_comes_back_and_matches_its_pattern(plane: str, to: str, sender: str) -> None:
    name = keys.stream_name(plane, to, sender)
    assert re.fullmatch(keys.STREAM, name) and keys.parse_stream_name(name) == (plane, to, sender)


@given(st.sampled_from(NODES))
def test_a_key_of_figures_comes_back(node: str) -> None:
    assert keys.parse_telemetry_key(keys.telemetry_key(node)) == node


@pytest.mark.parametrize("key", ["og/telemetry/moon/-", "og/telemetry/laser/robot_1", "og/telemetry/laser", "og/tick"])
def test_other_keys_are_no_figures(key: str) -> None:
    with pytest.raises(ValueError, match="figures"):
        keys.parse_telemetry_key(key)
