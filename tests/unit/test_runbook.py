"""The runbook has a section for each alert; what it and security.md tell a person to type or look at is there."""

from __future__ import annotations

import importlib
import re
import shlex
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import yaml
from orograph.cli.main import parser
from orograph.runtime.metric_names import INPUT_REASONS, WIRE_REASONS
from unit.test_dashboards import NAMES, asked, exported, panels, recorded

ROOT = Path(__file__).parents[2]
RUNBOOK = (ROOT / "docs/runbook.md").read_text()
DOCS = {"runbook": RUNBOOK, "security": (ROOT / "docs/security.md").read_text()}
ALERTS: list[dict[str, Any]] = [
    rule
    for group in yaml.safe_load((ROOT / "ops/prometheus/rules/alerts.yml").read_text())["groups"]
    for rule in group["rules"]
]
SERVICES = yaml.safe_load((ROOT / "compose.yaml").read_text())["services"]
TARGETS = set(re.findall(r"^([a-z-]+):", (ROOT / "Makefile").read_text(), re.M))
CLI = "python -m orograph.cli.main "
PARTS = ["Means", "You see", "Find", "Cure", "Ends"]


def sections() -> dict[str, str]:
    parts = re.split(r"^## (.+)\n", RUNBOOK, flags=re.M)
    return dict(zip(parts[1::2], parts[2::2], strict=True))


def spans(text: str) -> list[str]:
    """What stands between backticks, as one line each."""
    return [" ".join(span.split()) for span in re.findall(r"`([^`]+)`", text)]


def thresholds(alert: dict[str, Any]) -> set[str]:
    """The rule's numbers and times as the runbook writes them: 15, 0.95, 10 s, 1 min."""
    numbers = set(re.findall(r"[<>]=? (\d[\d.]*)(?![\w.])", alert["expr"])) - {"0"}
    times = re.findall(r"^(\d+)([sm])$|offset (\d+)(s)", f"{alert.get('for', '')}\n{alert['expr']}", re.M)
    words = {"s": "s", "m": "min"}
    return numbers | {f"{a or b} {words[unit or other]}" for a, unit, b, other in times}


def missing_names(text: str) -> Iterator[str]:
    rules = set(re.findall(r"[a-z_]+:[a-z_]+:[a-z0-9_]+", text))
    yield from sorted((asked(text) | rules) - {"orograph"} - exported() - recorded())
    yield from sorted(set(re.findall(r'reason="(\w+)"', text)) - {*INPUT_REASONS, *WIRE_REASONS})
    noted = {n for p in (ROOT / "shared").rglob("*.py") for n in re.findall(r'note\("([a-z-]+)"', p.read_text())}
    yield from sorted(set(re.findall(r"event `([^`]+)`", text)) - noted)


def missing_typed(span: str) -> Iterator[str]:
    """What of a span that is a command or a panel is not there."""
    words = span.split()
    while words and re.fullmatch(r"[A-Z_]+=\S*", words[0]):
        words.pop(0)
    command = " ".join(words)
    board, slash, panel = span.partition(" / ")
    if slash and (board not in NAMES or panel not in {p["title"] for p in panels(board)}):
        yield span
    if command.startswith("make ") and words[1] not in TARGETS:
        yield command
    if command.startswith("ops/compose ") and len(words) > 2:
        named = [word for word in words[2:] if not word.startswith("-")][:1]
        yield from (f"{command}: no service {word}" for word in named if word not in SERVICES)
    _, ours, line = command.rpartition(CLI) if CLI in command else command.partition("orograph ")
    if ours and (ours == CLI or command.startswith("orograph ")) and not is_understood(shlex.split(line)):
        yield command


def is_understood(line: list[str]) -> bool:
    """Whether `orograph` takes this line; one word alone names a command."""
    try:
        parser().parse_args([*line, "--help"] if len(line) == 1 else line)
    except SystemExit as ended:
        return ended.code == 0
    return True


def test_every_alert_has_its_section_and_every_section_its_alert() -> None:
    assert list(sections()) == [alert["alert"] for alert in ALERTS]
    for name, text in sections().items():
        assert re.findall(r"^\*\*(.+?)\.\*\* ", text, re.M) == PARTS, name
        assert set(re.findall(r"\b(?:[A-Z][a-z]+){2,}\b", text)) <= set(sections()), f"{name} names no alert"


@pytest.mark.parametrize("alert", ALERTS, ids=lambda alert: alert["alert"])
def test_a_section_tells_its_rules_numbers(alert: dict[str, Any]) -> None:
    said = set(re.findall(r"\d[\d.]*\d|\d", sections()[alert["alert"]]))
    times = set(re.findall(r"\d+ (?:s|min)\b", sections()[alert["alert"]]))
    assert thresholds(alert) <= said | times


def test_every_alert_points_at_its_section_also_where_it_is_tested() -> None:
    links = {alert["alert"]: f"docs/runbook.md#{alert['alert'].lower()}" for alert in ALERTS}
    assert {alert["alert"]: alert["annotations"]["runbook"] for alert in ALERTS} == links
    tests = yaml.safe_load((ROOT / "ops/prometheus/tests/alerts.yml").read_text())["tests"]
    for case in (case for test in tests for case in test["alert_rule_test"]):
        for expected in case.get("exp_alerts", []):
            assert expected["exp_annotations"]["runbook"] == links[case["alertname"]]


@pytest.mark.parametrize("name", DOCS)
def test_what_it_names_is_there(name: str) -> None:
    text = DOCS[name]
    assert [*missing_names(text), *(missing for span in spans(text) for missing in missing_typed(span))] == []


def test_it_is_reached_from_the_readme_and_security_is_short() -> None:
    for document in ("README.md", "docs/faults.md"):
        links = re.findall(r"\]\((?:docs/)?(\w+\.md)", (ROOT / document).read_text())
        assert {"runbook.md", "security.md"} <= set(links), document
    assert len(DOCS["security"].splitlines()) <= 80
    importlib.import_module(CLI.split()[-1])


def test_what_is_not_there_is_found() -> None:
    wrong = 'orograph_no_such, job:no_such:max, reason="none", event `no-such`'
    assert len([*missing_names(wrong)]) == 4
    for span in ("mission / No such", "make nothing", "X=1 make nothing", "ops/compose logs --tail=3 nobody",
                 "orograph dance", "orograph status --no-such", f"ops/compose exec console {CLI}dance"):  # fmt: skip
        assert len([*missing_typed(span)]) == 1, span
    assert thresholds({"expr": "a[1m] > 0.05 or b < c offset 15s", "for": "1m"}) == {"0.05", "15 s", "1 min"}
