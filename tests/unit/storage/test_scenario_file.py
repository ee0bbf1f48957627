"""Scenario files: every problem at once, each with its place and what was expected; tricks refused."""

import json
from pathlib import Path

import jsonschema
import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st
from orograph.storage.scenario_file import ScenarioError, load_scenario, scenario_json_schema

GOOD = """name: yard
title: A yard
starts:
  - {x_m: 10, y_m: 10}
base_station_m: [5, 5]
patrol:
  - [20, 20]
robots: 1
"""


def _write(folder: Path, text: str, buildings: str | None = None) -> Path:
    (folder / "scenario.yaml").write_text(text)
    if buildings is not None:
        (folder / "buildings.json").write_text(buildings)
    return folder


def _problems(folder: Path) -> tuple[str, ...]:
    with pytest.raises(ScenarioError) as caught:
        load_scenario(folder)
    return caught.value.problems


def test_a_good_file_by_folder_and_by_file(tmp_path: Path) -> None:
    folder = _write(tmp_path, GOOD)
    assert load_scenario(folder) == load_scenario(folder / "scenario.yaml")
    assert load_scenario(folder).patrol == ((20.0, 20.0),)


def test_every_problem_is_told_at_once_with_its_line_and_path(tmp_path: Path) -> None:
    bad = GOOD.replace("x_m: 10,", "x_m: here,").replace("robots: 1", "robots: 2.5\nsed: 3\nradio: {loss: 1.5}")
    problems = _problems(_write(tmp_path, bad))
    assert len(problems) == 4
    for line, path, words in [
        (4, "starts[0].x_m", "a number"),
        (8, "robots", "a whole number"),
        (9, "sed", "seed"),
        (10, "radio.loss", "at most 1"),
    ]:
        (told,) = [p for p in problems if f"scenario.yaml:{line}:" in p]
        assert path in told and words in told


def test_problems_between_fields_are_told(tmp_path: Path) -> None:
    problems = " ".join(
        _problems(_write(tmp_path, GOOD.replace("[20, 20]", "[-20, 20]").replace("robots: 1", "robots: 2")))
    )
    assert "patrol[0]" in problems and "robots" in problems


def test_buildings_beside_are_read_and_their_problems_named(tmp_path: Path) -> None:
    house = {"footprint": [[30, 30], [40, 30], [40, 40]], "height_m": 5}
    text = GOOD + "buildings: {file: buildings.json}\n"
    assert len(load_scenario(_write(tmp_path, text, json.dumps([house]))).buildings) == 1
    (problem,) = _problems(_write(tmp_path, text, json.dumps([house, {**house, "height_m": -5}])))
    assert "buildings.json" in problem and "buildings[1].height_m" in problem
    assert "not valid JSON" in _problems(_write(tmp_path, text, "[1,"))[0]


@pytest.mark.parametrize("name", ["../buildings.json", "/etc/hostname", "none.json"])
def test_a_file_outside_the_folder_or_missing_is_refused(tmp_path: Path, name: str) -> None:
    (tmp_path / "buildings.json").write_text("[]")
    (tmp_path / "inner").mkdir()
    assert "file" in _problems(_write(tmp_path / "inner", GOOD + f"buildings: {{file: {name}}}\n"))[0]


def test_alias_bombs_and_deep_nests_are_refused(tmp_path: Path) -> None:
    assert "alias" in _problems(_write(tmp_path, "a: &a [1]\nb: [*a, *a]\n"))[0]
    assert "nesting" in _problems(_write(tmp_path, "a: " + "[" * 40 + "]" * 40))[0]


def test_yaml_that_is_none_and_tags_that_run_code(tmp_path: Path) -> None:
    assert "scenario.yaml:2" in _problems(_write(tmp_path, "name: x\n  bad: [1\n"))[0]
    assert _problems(_write(tmp_path, GOOD + "seed: !!python/object/apply:os.getpid []\n"))


@given(st.text(max_size=300))
def test_noise_is_a_scenario_error_and_nothing_else(text: str) -> None:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(Path, "read_text", lambda *a, **k: text)
        patch.setattr(Path, "read_bytes", lambda *a, **k: text.encode("utf-8", "surrogatepass"))
        with pytest.raises(ScenarioError):
            load_scenario("scenarios/tiny")


def test_the_nearest_name_is_offered() -> None:
    with pytest.raises(ScenarioError, match="did you mean tiny"):
        load_scenario("tiney")


def test_the_schema_for_editors_is_current_and_takes_what_we_ship() -> None:
    schema = scenario_json_schema()
    assert json.loads(Path("scenarios/scenario.schema.json").read_text()) == schema
    for path in Path("scenarios").glob("*/scenario.yaml"):
        text = path.read_text()
        assert text.startswith("# yaml-language-server: $schema=../scenario.schema.json\n")
        jsonschema.validate(yaml.safe_load(text), schema)
