"""Whatever code and docs point at is there: documents, sections, headings, equations, files and functions."""

from __future__ import annotations

import ast
import io
import re
import subprocess
import tokenize
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import pytest
from orograph.storage.run_folder import MAP_INFO, REPORT, RUN, SCENARIO, SUMMARY, WORLD

ROOT = Path(__file__).parents[2]
LOOKED_IN = (ROOT, ROOT / "shared/orograph", ROOT / "docs", ROOT / "ops", ROOT / "tests")
DOCUMENT = re.compile(
    r"(?<![\w/.-])(?P<name>[a-z]+)\.md"
    r"(?:,? section (?P<section>\d+(?:\.\d+)?)|, (?P<words>\"[^\"]+\")| (?P<item>\d+)(?![\w.]))?"
)
CODE_IN_DOCS = re.compile(r"`(?P<path>[\w./-]+\.(?:py|yaml|toml|json|md))(?::(?P<name>\w+))?`")
FOLDER_IN_DOCS = re.compile(r"`(?P<path>[a-z_]+(?:/[a-z_-]+)*)/`")
CODE_IN_CODE = re.compile(r"(?<![\w./-])(?P<path>(?:[a-z_]+/)+[a-z_]+\.py)(?::(?P<name>\w+))?")
EQUATION = re.compile(r"\bEq\. (\d+)(?:-(\d+))?(?:, (?:Eq\. )?(\d+))?")
EQUATIONS = 12
MADE_BY_RUNS = {Path(file).name for file in (REPORT, SUMMARY, RUN, WORLD, SCENARIO, MAP_INFO)}


def _tracked(*patterns: str) -> list[Path]:
    command = ["git", "ls-files", "-co", "--exclude-standard", *patterns]
    listed = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=True)
    return [path for line in listed.stdout.splitlines() if (path := ROOT / line).exists()]


DOCS = [ROOT / "README.md", *_tracked("docs/*.md", "scenarios/*/README.md", "ops/kubernetes/README.md")]
CODE = [p for p in _tracked("*.py", "*.yaml", "*.yml", "Makefile", "ops/Dockerfile") if p != Path(__file__)]


def name_of(path: Path) -> str:
    return str(path.relative_to(ROOT))


def prose(path: Path) -> str:
    """Comments and strings of Python, the whole text of anything else."""
    text = path.read_text()
    if path.suffix != ".py":
        return text
    tokens = tokenize.generate_tokens(io.StringIO(text).readline)
    return "\n".join(t.string for t in tokens if t.type in (tokenize.COMMENT, tokenize.STRING))


@cache
def document(name: str) -> str | None:
    paths = [ROOT / "docs" / f"{name}.md", ROOT / f"{name}.md"]
    return next((path.read_text() for path in paths if path.exists()), None)


@cache
def names_in(path: Path) -> frozenset[str]:
    """Every function, class, method and assigned name of a Python file."""
    found = set()
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.FunctionDef | ast.ClassDef):
            found.add(node.name)
        elif isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store):
            found.add(node.id)
    return frozenset(found)


def resolve(path: str, beside: Path) -> Path | None:
    return next((base / path for base in (*LOOKED_IN, beside) if (base / path).exists()), None)


def missing_documents(text: str) -> Iterator[str]:
    for found in DOCUMENT.finditer(text):
        name = found["name"]
        if (there := document(name)) is None:
            yield f"{name}.md: no such document"
        elif found["section"] and not re.search(rf"^#+ {re.escape(found['section'])}[. ]", there, re.M):
            yield f"{name}.md has no section {found['section']}"
        elif found["words"] and not re.search(rf"^#+ {re.escape(found['words'].strip(chr(34)))}$", there, re.M):
            yield f"{name}.md has no heading {found['words']}"
        elif found["item"] and not re.search(rf"^{found['item']}\. ", there, re.M):
            yield f"{name}.md has no item {found['item']}"


def missing_equations(text: str) -> Iterator[str]:
    for found in EQUATION.finditer(text):
        for number in filter(None, found.groups()):
            if not 1 <= int(number) <= EQUATIONS:
                yield f"the paper has no Eq. {number}"


def missing_code(text: str, pattern: re.Pattern[str], beside: Path = ROOT) -> Iterator[str]:
    for found in pattern.finditer(text):
        name = found.groupdict().get("name")
        if found["path"] in MADE_BY_RUNS:
            continue
        if (path := resolve(found["path"], beside)) is None:
            yield f"{found['path']}: no such file"
        elif name and name not in names_in(path):
            yield f"{found['path']} defines no {name}"


@pytest.mark.parametrize("path", DOCS, ids=name_of)
def test_docs_point_at_what_is_there(path: Path) -> None:
    text = path.read_text()
    missing = [*missing_documents(text), *missing_equations(text)]
    missing += [*missing_code(text, CODE_IN_DOCS, path.parent), *missing_code(text, FOLDER_IN_DOCS, path.parent)]
    missing += [link for link in re.findall(r"\]\((?!https?:)([^)#]+)\)", text) if not (path.parent / link).exists()]
    assert missing == []


@pytest.mark.parametrize("path", CODE, ids=name_of)
def test_code_points_at_what_is_there(path: Path) -> None:
    text = prose(path)
    assert [*missing_documents(text), *missing_equations(text), *missing_code(text, CODE_IN_CODE)] == []


def test_a_mention_of_nothing_is_found() -> None:
    wrong = 'mapping.md section 99, protocol.md, "No such heading", zenoh.md 99, nowhere.md, Eq. 13, `mapping/none.py` '
    assert len([*missing_documents(wrong), *missing_equations(wrong), *missing_code(wrong, CODE_IN_DOCS)]) == 6
    nameless = "see mapping/mapper.py:no_such_step"
    assert [*missing_code(nameless, CODE_IN_CODE)] == ["mapping/mapper.py defines no no_such_step"]
    assert [*missing_code("`no_room/`", FOLDER_IN_DOCS)] == ["no_room: no such file"]


def test_the_tour_has_ten_stations_that_each_name_a_function() -> None:
    stations = re.findall(r"^\d+\. .*?(?=^\d+\. |^## )", (ROOT / "docs/tour.md").read_text(), re.M | re.S)
    assert len(stations) == 10
    assert all(any(found["name"] for found in CODE_IN_DOCS.finditer(station)) for station in stations)
