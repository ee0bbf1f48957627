"""What a process makes once for all its robots."""

from __future__ import annotations

import numpy as np
from orograph.registers import unpack
from orograph.scene.prior import given_layers, prior_records
from orograph.scene.site import Site
from orograph.sensing import View

WALL = {"footprint": [[120, 50], [125, 50], [125, 150], [120, 150]], "height_m": 10}


def test_each_thing_is_made_once_and_as_the_functions_make_it(flat_world):
    scenario = flat_world(buildings=[WALL], gps_quality={"default": 2})
    site = Site(scenario)
    np.testing.assert_array_equal(site.prior, prior_records(scenario))
    for ours, theirs in zip(site.given, given_layers(scenario), strict=True):
        np.testing.assert_array_equal(ours, theirs)
    for (name, ours), (_, theirs) in zip(
        site.prior_map.layers(), unpack(site.prior, scenario.grid.grid, *site.given).layers(), strict=True
    ):
        np.testing.assert_array_equal(ours, theirs, err_msg=name)
    assert site.prior is site.prior and site.given is site.given and site.prior_map is site.prior_map


def test_the_scene_and_its_imager_are_one_object_until_something_is_built(flat_world):
    site = Site(flat_world(changes=[{"at_s": 2.0, "until_s": 3.0, "build": WALL}]))
    view = View(site, robots=2)
    before, during, after = (site.scene(t) for t in (0, 2_000_000_000, 3_000_000_000))
    assert site.scene(1_999_999_999) is not during and len(during.building_meshes) == 1
    assert len(before.building_meshes) == len(after.building_meshes) == 0
    first = view.imager(0)
    assert view.imager(1_900_000_000) is first
    assert view.imager(2_000_000_000) is not first
    assert view.imager(2_100_000_000) is view.imager(2_900_000_000)
