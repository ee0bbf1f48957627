"""One mission in this process first: what all others are compared with, and it compiles every kernel once."""

import pytest
from orograph.launch.lifecycle import run
from orograph.storage.results import Summary
from orograph.storage.scenario_file import load_scenario


@pytest.fixture(scope="session", autouse=True)
def in_process(tmp_path_factory: pytest.TempPathFactory) -> Summary:
    return Summary.read(run(load_scenario("scenarios/tiny"), tmp_path_factory.mktemp("first") / "run", in_process=True))
