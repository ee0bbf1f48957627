from __future__ import annotations

import sys
from pathlib import Path

import pytest
from orograph.judge import provenance
from orograph.judge.provenance import code_digest


@pytest.fixture
def package(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A package whose `top` imports `mid`, which imports `deep`; `aside` stands alone."""
    folder = tmp_path / "madeup"
    folder.mkdir()
    texts = {
        "__init__": "", "top": "import json\nfrom madeup.mid import f\n", "aside": "x = 1\n", "deep": "x = 1\n",
        "mid": "def f():\n    from madeup import deep\n    return deep.x\n",
    }  # fmt: skip
    for name, text in texts.items():
        (folder / f"{name}.py").write_text(text)
    monkeypatch.syspath_prepend(tmp_path)
    yield folder
    sys.modules.pop("madeup", None)


def digest() -> str:
    code_digest.cache_clear()
    return code_digest("madeup.top")


@pytest.mark.parametrize(("name", "moves"), [("top", True), ("mid", True), ("deep", True), ("aside", False)])
def test_code_that_is_imported_moves_the_digest(package: Path, name: str, moves: bool) -> None:
    before = digest()
    with (package / f"{name}.py").open("a") as file:
        file.write("y = 2\n")
    assert (digest() != before) is moves


def test_the_reference_rests_on_all_that_makes_it() -> None:
    found = set(provenance._sources("orograph.judge.reference"))
    assert {
        "orograph.judge.reference", "orograph.judge.route", "orograph.mapping.fusion_kernels",
        "orograph.protocol.fold_kernels", "orograph.navigation.planner_kernels", "orograph.mission.split",
        "orograph.sensing.ray_kernels", "orograph.scene.prior",
    } <= found  # fmt: skip
    assert not {name.split(".")[1] for name in found if "." in name} & {"cli", "comms", "report", "runtime", "world"}
