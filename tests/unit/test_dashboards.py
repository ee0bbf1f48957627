"""The dashboards that are checked in are what build.py builds; each panel fits and asks for what is exported."""

from __future__ import annotations

import importlib.util
import json
import re
import sys
from itertools import combinations
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest
import yaml
from orograph.runtime import metrics
from orograph.runtime.metric_names import PROCESS, TELEMETRY

OPS = Path(__file__).parents[2] / "ops"
FILES = sorted((OPS / "grafana/dashboards").glob("*.json"))
NAMES = ["cluster", "mapping", "mission"]


@pytest.fixture(scope="module")
def build() -> ModuleType:
    spec = importlib.util.spec_from_file_location("grafana_build", OPS / "grafana/build.py")
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module  # dataclasses look their module up
    spec.loader.exec_module(module)
    return module


def panels(name: str) -> list[dict[str, Any]]:
    return json.loads((OPS / f"grafana/dashboards/{name}.json").read_text())["panels"]


def exported() -> set[str]:
    tables = [m.name for table in (*TELEMETRY.values(), PROCESS) for m in table.values()]
    timed = [metrics.STEP, metrics.WAIT, metrics.STAGE, metrics.COMMIT]
    histograms = [
        f"{family.name}{end}" for h in timed for family in h.describe() for end in ("_bucket", "_sum", "_count")
    ]
    return {*tables, *histograms, "orograph_claims_total", "orograph_figures_unnamed"}


def recorded() -> set[str]:
    groups = yaml.safe_load((OPS / "prometheus/rules/recording.yml").read_text())["groups"]
    return {rule["record"] for group in groups for rule in group["rules"]}


def rule_expressions() -> list[str]:
    files = [yaml.safe_load(f.read_text()) for f in (OPS / "prometheus/rules").glob("*.yml")]
    return [rule["expr"] for file in files for group in file["groups"] for rule in group["rules"]]


def asked(expression: str) -> set[str]:
    return set(re.findall(r"[a-z_]*:?\borograph[a-z_]*(?::[a-z0-9_]+)*", expression))


def test_what_is_checked_in_is_what_is_built(build: ModuleType) -> None:
    assert [f.stem for f in FILES] == NAMES
    for name, text in build.render().items():
        assert (OPS / "grafana/dashboards" / name).read_text() == text, (
            "run ops/grafana/build.py and commit what it writes"
        )


@pytest.mark.parametrize("name", NAMES)
def test_panels_fit_and_do_not_overlap(name: str) -> None:
    places = [panel["gridPos"] for panel in panels(name)]
    assert len(places) > 10
    for place in places:
        assert place["x"] + place["w"] <= 24
    for a, b in combinations(places, 2):
        beside = a["x"] + a["w"] <= b["x"] or b["x"] + b["w"] <= a["x"]
        above = a["y"] + a["h"] <= b["y"] or b["y"] + b["h"] <= a["y"]
        assert beside or above, (a, b)


@pytest.mark.parametrize("name", NAMES)
def test_panels_have_names_units_and_words(name: str) -> None:
    ids = [panel["id"] for panel in panels(name)]
    assert len(set(ids)) == len(ids)
    for panel in panels(name):
        assert panel["title"]
        if panel["type"] != "row":
            assert panel["targets"] and panel["fieldConfig"]["defaults"]["unit"]
            assert panel["datasource"]["uid"] == "prometheus"
            assert len({t["legendFormat"] for t in panel["targets"]}) == len(panel["targets"])


@pytest.mark.parametrize("name", NAMES)
def test_panels_ask_for_what_is_exported_or_recorded(name: str) -> None:
    known = exported() | recorded()
    for panel in panels(name):
        for target in panel.get("targets", []):
            assert asked(target["expr"]) <= known, (panel["title"], asked(target["expr"]) - known)


def test_rules_ask_for_what_is_exported_or_recorded() -> None:
    known = exported() | recorded()
    assert len(rule_expressions()) > 15
    for expression in rule_expressions():
        assert asked(expression) <= known, asked(expression) - known


def test_a_wrong_name_is_seen() -> None:
    assert asked("rate(orograph_scan_total[1m]) / robot:orograph_copy_behind:version") == {
        "orograph_scan_total", "robot:orograph_copy_behind:version",
    }  # fmt: skip
    assert not asked("rate(orograph_scan_total[1m])") <= exported() | recorded()


def test_every_alert_says_what_to_do() -> None:
    groups = yaml.safe_load((OPS / "prometheus/rules/alerts.yml").read_text())["groups"]
    alerts = [rule for group in groups for rule in group["rules"]]
    tests = yaml.safe_load((OPS / "prometheus/tests/alerts.yml").read_text())["tests"]
    cases = [case for test in tests for case in test.get("alert_rule_test", [])]
    for alert in alerts:
        assert alert["annotations"]["summary"] and alert["annotations"]["action"].endswith(".")
        assert alert["labels"]["severity"] in {"warning", "critical"}
        mine = [case for case in cases if case["alertname"] == alert["alert"]]
        assert any(case.get("exp_alerts") for case in mine), f"{alert['alert']}: no test in which it fires"
        assert any(not case.get("exp_alerts") for case in mine), f"{alert['alert']}: no test in which it does not"
