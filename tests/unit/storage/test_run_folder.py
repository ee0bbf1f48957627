from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from orograph import keys
from orograph.errors import InputError
from orograph.storage import run_folder
from orograph.storage.run_folder import cache_folder, new_folder, node_of, whole_file, write_arrays, write_whole


@given(st.sampled_from(keys.SERVICES), st.none() | st.integers(1, 999))
def test_a_node_s_files_name_it(service: str, number: int | None) -> None:
    node = keys.node(service, None if number is None else keys.robot_id(number))
    assert node_of(Path(run_folder.node_file(node))) == node
    assert node_of(Path(run_folder.stages_file(node))) == node


@pytest.mark.parametrize("name", ["scenario.json", "bytes-world.json", "toaster-robot_001.npz", "stages-laser-.json"])
def test_other_files_are_no_node_s(name: str) -> None:
    assert node_of(Path(name)) is None


def _write_half(path: Path) -> None:
    with whole_file(path) as stream:
        stream.write(b"half")
        raise RuntimeError


def test_a_file_is_whole_or_not_there(tmp_path: Path) -> None:
    path = tmp_path / "new" / "file.txt"
    with pytest.raises(RuntimeError):
        _write_half(path)
    assert list(path.parent.iterdir()) == []
    write_whole(path, "first")
    with pytest.raises(RuntimeError):
        _write_half(path)
    assert path.read_text() == "first" and list(path.parent.iterdir()) == [path]


def test_arrays_come_back(tmp_path: Path) -> None:
    write_arrays(tmp_path / "a.npz", {"x": np.arange(3), "text": np.array(["é"])})
    with np.load(tmp_path / "a.npz") as found:
        assert found["x"].tolist() == [0, 1, 2] and found["text"][0] == "é"


def test_a_new_folder_is_empty_and_has_the_next_number(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    assert [new_folder(None, "tiny") for _ in range(2)] == [Path("runs/tiny-001"), Path("runs/tiny-002")]
    write_whole(tmp_path / "full" / "something", "")
    for taken in (tmp_path / "full", tmp_path / "full" / "something"):
        with pytest.raises(InputError, match="not an empty folder"):
            new_folder(taken, "tiny")
    with pytest.raises(InputError, match="cannot be written"):
        new_folder(tmp_path / "full" / "something" / "below", "tiny")


def test_the_script_outside_python_uses_the_same_names() -> None:
    script = (Path(__file__).parents[3] / "ops" / "fetch-run").read_text()
    for name in (run_folder.LATEST, run_folder.SUMMARY, run_folder.REPORT):
        assert f"/{name}" in script


def test_the_cache_follows_the_xdg_rules(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("HOME", "/home/somebody")
    monkeypatch.delenv("XDG_CACHE_HOME", raising=False)
    assert cache_folder() == Path("/home/somebody/.cache/orograph")
    monkeypatch.setenv("XDG_CACHE_HOME", "/var/kept")
    assert cache_folder() == Path("/var/kept/orograph")
    monkeypatch.setenv("XDG_CACHE_HOME", "relative")
    assert cache_folder() == Path("/home/somebody/.cache/orograph")
