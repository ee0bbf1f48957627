"""Settings come back from the environment that they make for a child process."""

from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from orograph import keys
from orograph.runtime.settings import VARIABLES, Settings

ROBOTS = st.lists(st.integers(1, 999).map(keys.robot_id), unique=True, max_size=4).map(tuple)


@settings(suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(ROBOTS, st.integers(1, 100))
def test_a_child_reads_the_same(monkeypatch: pytest.MonkeyPatch, wanted: tuple[str, ...], capacity: int) -> None:
    mine = Settings("tcp/127.0.0.1:1", "tcp/127.0.0.1:2", Path("/runs"), capacity, wanted)
    for variable in VARIABLES:
        monkeypatch.setenv(variable, mine.environment[variable])
    assert Settings.from_environment() == mine


def test_what_is_missing_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    for variable in VARIABLES:
        monkeypatch.delenv(variable, raising=False)
    with pytest.raises(SystemExit, match=r"OROGRAPH_SIM .*OROGRAPH_RADIO .*OROGRAPH_RUN_DIR"):
        Settings.from_environment()


@pytest.mark.parametrize(("variable", "value"), [("CAPACITY", "0"), ("CAPACITY", "two"), ("CAPACITY", "1000"),
                                                 ("ROBOT", "robot_1"), ("ROBOT", "robot_001+moon")])  # fmt: skip
def test_what_cannot_be_is_one_line(monkeypatch: pytest.MonkeyPatch, variable: str, value: str) -> None:
    for name in VARIABLES:
        monkeypatch.setenv(name, "x" if name not in ("OROGRAPH_CAPACITY", "OROGRAPH_ROBOT") else "")
    monkeypatch.setenv("OROGRAPH_CAPACITY", "1")
    monkeypatch.setenv(f"OROGRAPH_{variable}", value)
    with pytest.raises(SystemExit, match=f"OROGRAPH_{variable}: expected .*, found "):
        Settings.from_environment()
