"""Metrics: every figure of every node has a name that follows Prometheus; counted once, bounded, never in the way."""

from __future__ import annotations

import inspect
import re
import threading
import urllib.request
from collections.abc import Iterator
from contextlib import contextmanager

import pytest
from orograph import fields, keys, kinds
from orograph.comms import wire
from orograph.comms.bus import Bus
from orograph.comms.mailbox import Mailbox
from orograph.launch.in_process import build_rounds
from orograph.protocol import manager, validate
from orograph.protocol.store import MemoryStore
from orograph.runtime import metric_names, metrics
from orograph.runtime.metric_names import TELEMETRY, Metric, label_of, place
from orograph.runtime.metrics import Figures
from orograph.stages import STAGES, StageRecorder
from orograph.storage.recording import Recording
from orograph.storage.scenario_file import load_scenario
from prometheus_client import CollectorRegistry, generate_latest
from prometheus_client.openmetrics.exposition import generate_latest as openmetrics
from prometheus_client.openmetrics.parser import text_string_to_metric_families as parse_strictly
from prometheus_client.parser import text_string_to_metric_families as parse

ALL = [m for table in (*TELEMETRY.values(), metric_names.PROCESS) for m in table.values()]
FRAMES = 40


def registry_of(figures: Figures) -> CollectorRegistry:
    registry = CollectorRegistry()
    registry.register(figures)
    return registry


def samples(figures: Figures) -> dict[tuple[str, tuple[tuple[str, str], ...]], float]:
    text = generate_latest(registry_of(figures)).decode()
    return {(s.name, tuple(sorted(s.labels.items()))): s.value for family in parse(text) for s in family.samples}


@pytest.fixture(scope="module")
def telemetry(tmp_path_factory: pytest.TempPathFactory) -> dict[str, dict[str, float]]:
    """What each node of a mission tells after a few seconds."""
    out, scenario = tmp_path_factory.mktemp("run"), load_scenario("scenarios/tiny")
    with Recording(out, "in-process") as recording:
        rounds = build_rounds(scenario, MemoryStore(), recording, {})
        for _ in range(FRAMES):
            rounds.step()
        return {node.name: dict(node.telemetry()) for node in rounds.nodes}


def test_each_figure_of_each_node_has_its_name(telemetry: dict[str, dict[str, float]]) -> None:
    assert {keys.split(name)[0] for name in telemetry} == set(keys.SERVICES)
    for node, told in telemetry.items():
        service = keys.split(node)[0]
        for figure in told:
            named = place(TELEMETRY[service], figure) is not None or (service, figure) in metric_names.SUMS
            assert named, f"{service} tells {figure}, which has no row in metric_names"


def test_each_row_is_told_by_its_node(telemetry: dict[str, dict[str, float]]) -> None:
    """No row outlives its figure; refusals alone are told only once they happen."""
    for service in keys.SERVICES:
        told = {figure for node, figures in telemetry.items() if keys.split(node)[0] == service for figure in figures}
        for row, metric in TELEMETRY[service].items():
            if row != "rejected_{reason}":
                assert any(place({row: metric}, figure) for figure in told), f"{service} never tells {row}"


def test_what_is_told_is_what_is_exported(telemetry: dict[str, dict[str, float]]) -> None:
    figures = Figures()
    figures.show(telemetry, {})
    exported = samples(figures)
    assert exported["orograph_figures_unnamed", ()] == 0
    robot = (("robot", "robot_002"),)
    mapping = telemetry["robot-mapping/robot_002"]
    assert exported["orograph_mapping_scans_total", robot] == mapping["scans"] > 0
    dropped = exported["orograph_mapping_points_dropped_total", (("reason", "outside_grid"), *robot)]
    assert dropped == mapping["points_outside_grid"]
    assert exported["orograph_map_version", ()] == telemetry["map-manager"]["version"] > 0
    assert exported["orograph_world_frames_total", ()] == FRAMES - 1
    assert exported["orograph_robot_silence_seconds", robot] == telemetry["orchestrator"]["silence_robot_002_s"]


def test_the_text_passes_the_strict_parser(telemetry: dict[str, dict[str, float]]) -> None:
    figures = Figures()
    figures.show(telemetry, dict.fromkeys(("simulation_s", "lost", "sent_bytes_radio", "rejected_crc"), 1.0))
    families = list(parse_strictly(openmetrics(registry_of(figures)).decode()))
    assert len(families) > 50
    assert all(family.documentation for family in families)


@pytest.mark.parametrize("metric", ALL, ids=lambda m: m.name)
def test_names_follow_the_conventions(metric: Metric) -> None:
    check_name(metric)


def check_name(metric: Metric) -> None:
    assert re.fullmatch(r"orograph(_[a-z]+)+", metric.name)
    assert metric.name.endswith("_total") == (metric.kind == "counter")
    words = metric.name.split("_")
    assert not {"ms", "ns", "s", "m", "mb", "kb", "milliseconds", "percent", "fraction", "gauge", "counter"} & set(
        words
    )
    assert words[-1] not in {"count", "sum", "bucket"}
    assert metric.help.endswith(".") and metric.help[0] in "01ABCDEFGHIJKLMNOPQRSTUVWXYZ"


@pytest.mark.parametrize(("name", "kind"), [
    ("orograph_age_ms", "gauge"), ("orograph_scans", "counter"), ("orograph_scans_total", "gauge"), ("scans", "gauge"),
    ("orograph_step_count", "gauge"),
])  # fmt: skip
def test_the_check_of_names_can_fail(name: str, kind: metric_names.Kind) -> None:
    with pytest.raises(AssertionError):
        check_name(Metric(name, kind, "Something."))


def test_no_name_means_two_things() -> None:
    names = [metric.name for metric in ALL]
    assert len(names) == len(set(names))


def test_an_unknown_figure_is_counted_and_not_exported() -> None:
    figures = Figures()
    figures.show({"world": {"robots": 1.0, "colour": 3.0}}, {"lost": 2.0, "nonsense": 1.0})
    exported = samples(figures)
    assert exported["orograph_figures_unnamed", ()] == 2
    assert not any("colour" in name for name, _ in exported)
    assert exported["orograph_mailbox_lost_messages_total", ()] == 2


def test_labels_take_bounded_values_only() -> None:
    orchestrator = TELEMETRY[keys.ORCHESTRATOR]
    assert place(orchestrator, "silence_robot_999_s") is not None
    for bad in ("silence_robot_1000_s", "silence_anybody_s", "silence__s"):
        assert place(orchestrator, bad) is None
    assert place(metric_names.PROCESS, "rejected_" + "x" * 41) is None
    assert place(metric_names.PROCESS, "sent_bytes_moon") is None


def test_reasons_are_shown_before_they_happen() -> None:
    """An alert on a counter that appears with its first count misses that count."""
    figures = Figures()
    figures.show({"map-manager": {}}, {"lost": 0.0})
    exported = samples(figures)
    source = inspect.getsource(wire) + inspect.getsource(fields) + inspect.getsource(kinds)
    reasons = set(re.findall(r'(?:Rejected\(|require\(.*?, )"(\w+)"', source))
    assert {"crc", "range", "shape"} <= reasons
    for reason in reasons:
        assert exported["orograph_mailbox_rejected_messages_total", (("reason", reason),)] == 0
    source = inspect.getsource(validate) + inspect.getsource(manager)
    reasons = set(re.findall(r'(?:return|reason.*=|self.rejected\[)\s*"([a-z-]+)"', source))
    assert {"cell-range", "flood", "unknown-robot"} <= reasons
    for reason in reasons:
        assert exported["orograph_map_inputs_rejected_total", (("reason", reason.replace("-", "_")),)] == 0


def test_each_pass_of_a_stage_is_observed_once() -> None:
    ticks = iter(range(0, 10**9, 1000))
    recorder, figures = StageRecorder(lambda: next(ticks), keep=8), Figures()
    figures.time_stages([recorder])
    before = stage_count("height")
    for passes in (3, 0, 2, 4):
        for _ in range(passes):
            with recorder("height"):
                pass
        figures.show({}, {})
    assert stage_count("height") - before == 9
    assert stage_count("fold") is not None, "every stage is shown from the start"


def stage_count(stage: str) -> float:
    assert stage in STAGES
    return sum(s.value for f in metrics.STAGE.collect() for s in f.samples
               if s.name.endswith("_count") and s.labels == {"stage": stage})  # fmt: skip


@contextmanager
def served(registry: CollectorRegistry) -> Iterator[str]:
    server = metrics.serve("127.0.0.1", 0, registry)
    try:
        yield f"http://127.0.0.1:{server.server_port}"
    finally:
        server.shutdown()
        server.server_close()


def test_a_scrape_gets_the_newest_figures_and_any_path_an_answer() -> None:
    figures = Figures()
    with served(registry_of(figures)) as url:
        for version in (7, 8):
            figures.show({"map-manager": {"version": version}}, {})
            with urllib.request.urlopen(f"{url}/metrics", timeout=5) as answer:
                assert f"orograph_map_version {version}.0".encode() in answer.read()
        for path in ("/", "/../../etc/passwd", "/metrics?name[]=" + "x" * 5000):
            with urllib.request.urlopen(url + path, timeout=5) as answer:
                assert b"root:" not in answer.read()


def test_figures_may_change_while_they_are_scraped() -> None:
    figures, stop = Figures(), threading.Event()

    def change() -> None:
        n = 0
        while not stop.is_set():
            n = n % 100 + 1
            figures.show({f"laser/{keys.robot_id(i + 1)}": {"scans": n} for i in range(n)}, {"lost": n})

    writer = threading.Thread(target=change)
    writer.start()
    try:
        for _ in range(100):
            assert samples(figures)["orograph_figures_unnamed", ()] == 0
    finally:
        stop.set()
        writer.join()


def test_a_taken_port_is_one_clear_line() -> None:
    with served(CollectorRegistry()) as url:
        port = int(url.rsplit(":", 1)[1])
        with pytest.raises(SystemExit, match=f"cannot serve metrics on 127.0.0.1:{port}: Address already in use"):
            metrics.serve("127.0.0.1", port, CollectorRegistry())


@pytest.mark.parametrize("text", ["", "none", "0", "70000", "-1", "1.5", "host:", "9464:"])
def test_a_bad_port_is_refused(text: str) -> None:
    with pytest.raises(ValueError, match="ADDRESS"):
        metrics.endpoint(text)


def test_a_port_alone_is_for_a_container() -> None:
    assert metrics.endpoint("9464") == ("0.0.0.0", 9464)
    assert metrics.endpoint("127.0.0.1:9464") == ("127.0.0.1", 9464)


def test_a_row_has_one_label_of_its_own() -> None:
    for table in (*TELEMETRY.values(), metric_names.PROCESS):
        for row, metric in table.items():
            assert (label_of(row) is not None) == ("{" in row)
            assert not metric.known or label_of(row)


def test_counters_of_a_process_are_there_before_they_count() -> None:
    bus, scenario = Bus({}), load_scenario("scenarios/tiny")
    figures = metrics.process_figures(
        1_500_000_000, scenario, ["laser/robot_001", "laser/robot_002"], Mailbox(scenario.robot_ids), bus
    )
    assert figures["simulation_s"] == 1.5 and figures["robots_held"] == 2
    assert (figures["lost"], figures["overflowed"], figures["skipped"]) == (0, 0, 0)
    told = Figures()
    told.show({}, figures)
    exported = samples(told)
    assert exported["orograph_figures_unnamed", ()] == 0
    assert exported["orograph_sent_bytes_total", (("plane", "radio"),)] == 0


def test_bytes_are_summed_by_plane_and_refusals_counted() -> None:
    bus, mailbox = Bus({}), Mailbox(["robot_001"])
    bus.bytes_sent.update({("radio", "map-manager", "a"): 5, ("radio", "x", "b"): 7, ("sim", "world", "a"): 11})
    mailbox.add("og/radio/nonsense", b"")
    mailbox.add("og/radio/map-manager/-/Batch/robot-mapping/robot_001", b"short")
    figures = metrics.process_figures(0, load_scenario("scenarios/tiny"), ["world"], mailbox, bus)
    assert (figures["sent_bytes_radio"], figures["sent_bytes_sim"]) == (12, 11)
    assert figures["received_bytes_radio"] == 5 and figures["robots_held"] == 0
    told = Figures()
    told.show({}, figures)
    rejected = {
        labels[0][1]: n
        for (name, labels), n in samples(told).items()
        if name == "orograph_mailbox_rejected_messages_total"
    }
    assert rejected["key"] == 1 and sum(rejected.values()) == 2
