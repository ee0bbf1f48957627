from __future__ import annotations

import re
from collections.abc import Callable
from html.parser import HTMLParser
from pathlib import Path
from urllib.parse import unquote

import numpy as np
import pytest
from made_up.run import leave
from orograph import keys
from orograph.layers import KINDS, LAYERS
from orograph.report import folder
from orograph.report.folder import compose
from orograph.stages import STAGES
from orograph.storage.parts import RunParts, read_parts
from orograph.storage.results import Summary
from orograph.storage.run_folder import EVENTS, GLRM, PARTS, REPORT, SUMMARY, FolderError, events_file, hrm_file

MAX_REPORT_BYTES = 6_000_000


class Page(HTMLParser):
    """What a page refers to, and whether its tags close."""

    def __init__(self) -> None:
        super().__init__()
        self.links: list[str] = []
        self.alts: list[str] = []
        self.open: list[str] = []
        self.ids: set[str] = set()

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        found = dict(attrs)
        self.links += [v for k, v in attrs if k in ("src", "href") and v]
        self.ids |= {v for k, v in attrs if k == "id" and v}
        if tag == "img":
            self.alts.append(found.get("alt") or "")
        elif tag not in ("meta", "br", "link"):
            self.open.append(tag)

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag


@pytest.fixture(scope="module")
def finished(city_run: RunParts, tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("run")
    leave(city_run, out)
    compose(out, tmp_path_factory.mktemp("cache"))
    return out


def test_parts_survive_the_way_through_the_folder(city_run: RunParts, finished: Path) -> None:
    read = read_parts(finished)
    assert read.scenario == city_run.scenario
    assert set(read.nodes) == set(city_run.nodes)
    for name, arrays in city_run.nodes.items():
        for key, array in arrays.items():
            np.testing.assert_array_equal(read.nodes[name][key], array)
    assert (read.bytes_up, read.bytes_down) == (city_run.bytes_up, city_run.bytes_down)
    assert [e["stamp_ns"] for e in read.events] == sorted(e["stamp_ns"] for e in city_run.events)
    assert read.stages_ns[keys.MANAGER]["fold"].tolist() == city_run.stages_ns[keys.MANAGER]["fold"].tolist()


def test_the_finished_folder_has_everything(finished: Path) -> None:
    names = {p.name for p in finished.iterdir()}
    assert names == {PARTS, SUMMARY, REPORT, EVENTS, GLRM, hrm_file("robot_001"), hrm_file("robot_002")}
    with np.load(finished / GLRM) as glrm:
        assert {*LAYERS, "origin_m", "cell_m"} <= set(glrm.files) <= {*KINDS, "origin_m", "cell_m"}
        assert glrm["height"].shape == (32, 32)


def test_what_changed_is_in_the_summary_the_map_and_the_report(finished: Path) -> None:
    (change,) = Summary.read(finished).surface_changes
    assert (change.row, change.col, change.x_m, change.y_m) == (3, 4, 22.5, 17.5)
    assert (change.since_s, change.told_s, change.from_top_m, change.to_top_m) == (30.5, 36.0, None, 9.75)
    with np.load(finished / GLRM) as glrm:
        assert np.argwhere(np.isfinite(glrm["changed_at"])).tolist() == [[3, 4]] and glrm["changed_at"][3, 4] == 30.5
    assert "What changed" in (finished / REPORT).read_text()


def test_the_summary_has_its_keys_and_true_figures(finished: Path) -> None:
    summary = Summary.read(finished)
    assert set(summary.stages_ms) == set(STAGES)
    assert set(summary.mapping_time_s) == {50, 90, 95, 99}
    assert (summary.robots, summary.rtf, summary.cells_lost) == (2, 8.0, 0)
    assert (summary.bytes_up_per_robot_s, summary.copies_hash_equal) == (1500.0, True)
    # The made-up maps are the true surface with 5 cm of noise, averaged nowhere.
    assert summary.score.hrm.surface.open_ground.rmse_m == pytest.approx(0.05, abs=0.01)
    assert summary.score.hrm.surface.occupation_iou > 0.9


def test_the_page_is_one_file_that_asks_nobody(finished: Path) -> None:
    text = (finished / REPORT).read_text()
    page = Page()
    page.feed(text)
    assert not page.open
    assert len(page.alts) == 14
    assert all(len(alt) > 20 for alt in page.alts)
    for link in page.links:
        assert link.startswith("data:image/svg+xml,") or link[1:] in page.ids, link[:80]
    assert not re.search(r"@import|url\((?!#)|<script", unquote(text))
    assert len(text) < MAX_REPORT_BYTES


def test_the_scenarios_words_are_escaped(finished: Path) -> None:
    text = (finished / REPORT).read_text()
    assert "Drawn by the tests &lt;b&gt;themselves" in text


def test_the_same_parts_give_the_same_page(city_run: RunParts, finished: Path, tmp_path: Path) -> None:
    leave(city_run, tmp_path)
    compose(tmp_path, tmp_path / "another-cache")
    assert (tmp_path / REPORT).read_bytes() == (finished / REPORT).read_bytes()


def test_missing_nodes_are_named_and_left_out(without: Callable[..., RunParts], tmp_path: Path) -> None:
    names = [keys.WORLD, keys.MANAGER, keys.ORCHESTRATOR, *(keys.node(s, "robot_001") for s in keys.ROBOT_SERVICES)]
    leave(without(*names), tmp_path)
    compose(tmp_path, tmp_path / "cache")
    summary = Summary.read(tmp_path)
    assert summary.glrm_hash is None
    assert summary.mapping_time_s[95] is None
    assert set(summary.missing_parts) == set(names)
    assert "robot-mapping/robot_001" in (tmp_path / REPORT).read_text()


def test_a_failed_composition_leaves_no_finished_name(
    city_run: RunParts, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    leave(city_run, tmp_path)
    (tmp_path / SUMMARY).write_text("of an earlier composition")

    def fail(*_: object) -> str:
        raise RuntimeError("the page cannot be made")

    monkeypatch.setattr(folder.page, "render", fail)
    with pytest.raises(RuntimeError):
        compose(tmp_path, tmp_path / "cache")
    assert not (tmp_path / SUMMARY).exists()
    assert not (tmp_path / REPORT).exists()


def test_a_line_cut_short_by_a_death_is_no_event(city_run: RunParts, tmp_path: Path) -> None:
    leave(city_run, tmp_path)
    with (tmp_path / events_file("p0")).open("a") as stream:
        stream.write('{"stamp_ns": 12, "eve')
    assert len(read_parts(tmp_path).events) == len(city_run.events)


def test_a_folder_without_a_run_is_named(tmp_path: Path) -> None:
    with pytest.raises(FolderError, match=r"scenario\.json cannot be read"):
        read_parts(tmp_path)
