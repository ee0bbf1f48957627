"""What stands when, by hand."""

from __future__ import annotations

import numpy as np
import pytest
from orograph.scenario import Scenario
from orograph.scene import build_scene
from orograph.scene.changes import epoch, solids, standing
from orograph.sensing.truth import top_surface
from pydantic import ValidationError

SECOND_NS = 1_000_000_000
HOUSE = {"footprint": [[20, 20], [30, 20], [30, 30], [20, 30]], "height_m": 6.0}
SHED = {"footprint": [[50, 50], [55, 50], [55, 55], [50, 55]], "height_m": 3.0}
CHANGES = [
    {"at_s": 2.0, "until_s": 5.0, "park": {"x_m": 72.5, "y_m": 72.5, "heading_deg": 90, "size_m": [4, 2, 1.5]}},
    {"at_s": 3.0, "build": SHED},
    {"at_s": 3.0, "until_s": 9.5, "remove": 0},
]


@pytest.fixture
def changing(flat_world) -> Scenario:
    return flat_world(buildings=[HOUSE], changes=CHANGES)


@pytest.mark.parametrize(
    ("seconds", "names"),
    [
        (0.0, ["buildings[0]"]),
        (1.999999999, ["buildings[0]"]),
        (2.0, ["buildings[0]", "changes[0]"]),
        (3.0, ["changes[0]", "changes[1]"]),
        (5.0, ["changes[1]"]),
        (9.5, ["buildings[0]", "changes[1]"]),
        (7200.0, ["buildings[0]", "changes[1]"]),
    ],
)
def test_what_stands(changing, seconds, names):
    assert standing(changing, round(seconds * SECOND_NS)) == names
    assert len(build_scene(changing, round(seconds * SECOND_NS)).building_meshes) == len(names)


def test_epochs_change_with_the_scene_alone(changing):
    stamps_ns = [k * SECOND_NS // 10 for k in range(120)]
    epochs, scenes = ([of(changing, stamp_ns) for stamp_ns in stamps_ns] for of in (epoch, standing))
    begins = [k for k in range(1, 120) if epochs[k] != epochs[k - 1]]
    assert begins == [k for k in range(1, 120) if scenes[k] != scenes[k - 1]] == [20, 30, 50, 95]


def test_a_parked_box_stands_turned_in_its_place(changing):
    footprint = np.array(solids(changing)["changes[0]"].footprint)
    assert sorted(np.round(footprint, 6).tolist()) == [[71.5, 70.5], [71.5, 74.5], [73.5, 70.5], [73.5, 74.5]]
    height, occupied = top_surface(build_scene(changing, 2 * SECOND_NS), changing.grid.grid.refined(10), 1)
    assert set(np.unique(height[:, 120:]).tolist()) == {0.0, 1.5}
    assert occupied[:, 120:].sum() == 4 * 2 / 0.25


def test_without_changes_nothing_ever_changes(flat_world):
    scenario = flat_world(buildings=[HOUSE])
    assert epoch(scenario, 0) == epoch(scenario, 10**12) == ()


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"at_s": 1.0}, "exactly one of build, park and remove"),
        ({"at_s": 1.0, "build": SHED, "remove": 0}, "exactly one of build, park and remove"),
        ({"at_s": 4.0, "until_s": 4.0, "remove": 0}, "until_s (4) must come after at_s (4)"),
        ({"at_s": 4.0, "remove": 1}, "buildings[1] is not there, found 1"),
    ],
)
def test_senseless_changes_are_refused_in_words(flat_world, change, words):
    with pytest.raises(ValidationError) as refused:
        flat_world(buildings=[HOUSE], changes=[change])
    assert words in str(refused.value)


def test_a_bad_footprint_is_named_before_its_time_has_come(flat_world):
    crossed = {**SHED, "footprint": [[50, 50], [55, 55], [55, 50], [50, 55]]}
    with pytest.raises(ValueError, match=r"^changes\[0\]: "):
        build_scene(flat_world(changes=[{"at_s": 100.0, "build": crossed}]))
