"""Faces and distances from Embree: the nearest ones, and the same ones whatever instructions the CPU has."""

from __future__ import annotations

import ctypes

import embreex
import numpy as np
import pytest
from orograph.geometry import ray_directions, rotation
from orograph.scenario import LaserSpec
from orograph.scene import Mesh, build_scene
from orograph.sensing import embree
from orograph.sensing.bodies import NO_BOXES
from orograph.sensing.casting import RayCaster

NATIVE_RAY8, NATIVE_RAY16 = 33, 34
"""RTC_DEVICE_PROPERTY_NATIVE_RAY*_SUPPORTED: true where the device uses registers so wide."""
BLOCKS = [{"footprint": [[x, y], [x + 13, y + 1], [x + 11, y + 9], [x, y + 8]], "height_m": 6, "roof": "gable",
           "roof_height_m": 2} for x in range(50, 150, 25) for y in range(50, 150, 25)]  # fmt: skip


def wide(device: embree.Device, native: int) -> bool:
    ask = embree._LIBRARY.rtcGetDeviceProperty
    ask.restype, ask.argtypes = ctypes.c_ssize_t, (ctypes.c_void_p, ctypes.c_int)
    return bool(ask(device.address, native))


def test_the_product_never_takes_wider_vectors_than_every_cpu_of_its_kind_has():
    device = embree.Device()
    assert not wide(device, NATIVE_RAY16)
    assert wide(device, NATIVE_RAY8) == wide(embree.Device("avx512"), NATIVE_RAY8)


@pytest.mark.parametrize("isa", ["sse4.2", "avx", "avx512"])
def test_distances_do_not_depend_on_the_instructions(flat_world, isa):
    """What a CPU lacks Embree leaves out of an isa, so each of these runs anywhere, and says less on an older one."""
    waves = [{"amplitude_m": 1.5, "wavelength_m": 90, "heading_deg": 40}, {"amplitude_m": 0.3, "wavelength_m": 11}]
    scene = build_scene(flat_world(buildings=BLOCKS, terrain={"waves": waves, "mesh_cell_m": 2}))
    product, other = RayCaster(scene, 80.0), RayCaster(scene, 80.0, isa=isa)
    directions = np.ascontiguousarray(ray_directions(LaserSpec(rings=16, columns=1440)).reshape(-1, 3).T)
    draw, met, differing = np.random.default_rng(3), 0, 0
    for _ in range(20):
        x, y = draw.uniform(30, 170, 2)
        eye, R = np.array([x, y, float(scene.height_m(x, y)) + 0.5]), rotation(*draw.uniform(-0.3, 0.3, 3))
        expected = product.distances(eye, R, directions, NO_BOXES).copy()
        got = other.distances(eye, R, directions, NO_BOXES)
        met, differing = met + int(np.isfinite(expected).sum()), differing + int((got != expected).sum())
    assert met > 100_000
    assert differing == 0, f"{differing} of {met}, seed 3"


def test_the_nearest_face_of_a_few_and_its_distance():
    corners = np.array([(0, 0), (1, 0), (1, 1), (0, 1)], np.float64)
    squares = [np.c_[corners, np.full(4, z)] for z in (0.0, -2.0, -7.0)]
    faces = np.array([[0, 1, 2], [0, 2, 3]], np.int32)
    mesh = Mesh(np.concatenate(squares), np.concatenate([faces + 4 * i for i in range(3)]))
    solid = embree.Solid(embree.Device(), mesh, np.zeros(3))
    origins = np.array([(0.7, 0.2, z) for z in (1.0, -0.5, -3.0, -8.0, 1.0, 30.0)] + 2 * [(5.0, 5.0, 1.0)]).T.copy()
    down = np.repeat(np.array([[0], [0], [-1]], np.float32), 8, axis=1)
    down[:, 4] = 0, 0, 1
    met, away = np.empty(8, np.int32), np.empty(8)
    solid.meet(origins, down, 25.0, met, away)
    np.testing.assert_array_equal(met, [0, 2, 4, -1, -1, -1, -1, -1])
    np.testing.assert_array_equal(away, [1.0, 1.5, 4.0, *(5 * [np.inf])])


def test_a_wheel_without_its_library_is_named_with_its_cure(tmp_path, monkeypatch):
    monkeypatch.setattr(embreex, "__file__", str(tmp_path / "embreex" / "__init__.py"))
    with pytest.raises(ImportError, match=r"no libembree4 in .*embreex\.libs; reinstall it: pip install"):
        embree._library()
