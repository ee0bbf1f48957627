"""The house rules that a program can hold: lengths, who reads the environment, and documented messages and keys."""

from __future__ import annotations

import ast
import inspect
from collections.abc import Iterator
from pathlib import Path

import pytest
from orograph import control, fields, keys, messages, routes

ROOT = Path(__file__).parents[2]
FILES = [
    *sorted((ROOT / "shared").rglob("*.py")), *sorted((ROOT / "services").rglob("*.py")),
    *sorted((ROOT / "tests").rglob("*.py")),
]  # fmt: skip
FILE_LINES, FUNCTION_LINES, SERVICE_LINES = 400, 70, 150
FORBIDDEN_NAMES = {"utils", "helpers", "common", "base", "info", "util", "misc"}


def name_of(path: Path) -> str:
    return str(path.relative_to(ROOT))


def functions(tree: ast.AST) -> Iterator[ast.FunctionDef | ast.AsyncFunctionDef]:
    for node in ast.walk(tree):
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
            yield node


def is_kernel(function: ast.FunctionDef | ast.AsyncFunctionDef) -> bool:
    return any("njit" in ast.unparse(decorator) for decorator in function.decorator_list)


def test_there_is_something_to_look_at() -> None:
    assert len(FILES) > 20


@pytest.mark.parametrize("path", FILES, ids=name_of)
def test_file_is_short_and_well_named(path: Path) -> None:
    lines = path.read_text().count("\n")
    limit = SERVICE_LINES if path.is_relative_to(ROOT / "services") else FILE_LINES
    assert lines <= limit, f"{name_of(path)}: {lines} lines, at most {limit}"
    assert path.stem not in FORBIDDEN_NAMES


@pytest.mark.parametrize("path", FILES, ids=name_of)
def test_functions_are_short(path: Path) -> None:
    for function in functions(ast.parse(path.read_text())):
        lines = (function.end_lineno or 0) - function.lineno + 1
        where = f"{name_of(path)}:{function.lineno} {function.name}"
        assert lines <= FUNCTION_LINES or is_kernel(function), f"{where}: {lines} lines, at most {FUNCTION_LINES}"
        if path.is_relative_to(ROOT / "shared"):
            assert not function.name.startswith(("get_", "handle_")), where


READS_ENVIRONMENT = {"shared/orograph/runtime/settings.py", "shared/orograph/storage/run_folder.py"}


def test_only_two_files_read_the_environment() -> None:
    for path in FILES:
        if path.is_relative_to(ROOT / "tests") or name_of(path) in READS_ENVIRONMENT:
            continue
        for node in ast.walk(ast.parse(path.read_text())):
            where = f"{name_of(path)}:{getattr(node, 'lineno', 0)}"
            if isinstance(node, ast.Attribute):
                assert node.attr not in {"environ", "getenv"}, where
            if isinstance(node, ast.ImportFrom) and node.module == "os":
                assert not {alias.name for alias in node.names} & {"environ", "getenv"}, where


@pytest.mark.parametrize("kind", messages.KINDS.values(), ids=lambda kind: kind.__name__)
def test_each_message_says_what_it_is_who_sends_it_and_what_each_field_may_hold(kind: type[messages.Message]) -> None:
    assert inspect.getdoc(kind) and kind.routes and all(fields.kinds_of(kind).values())
    assert set(kind.newest_by or ()) <= fields.kinds_of(kind).keys()
    for route in kind.routes:
        services = {route.sender, keys.split(route.to)[0]}
        assert services <= set(keys.SERVICES if route.plane == keys.SIM else keys.RADIO_SERVICES), route


@pytest.mark.parametrize("kind", control.CONTROLS.values(), ids=lambda kind: kind.__name__)
def test_each_control_message_says_what_it_is_its_key_and_who_sends_it(kind: type[control.Control]) -> None:
    assert inspect.getdoc(kind) and kind.routes and all(fields.kinds_of(kind).values())
    assert keys.callback_kind(kind.key) in keys.CALLBACKS
    for route in kind.routes:
        assert {route.sender, route.to} <= {*keys.SERVICES, routes.ANYONE, routes.PEOPLE}, route


def test_every_key_has_its_words() -> None:
    tree = ast.parse(inspect.getsource(keys))
    for i, node in enumerate(tree.body):
        if isinstance(node, ast.FunctionDef):
            assert ast.get_docstring(node), node.name
        is_key = isinstance(node, ast.Assign) and ast.unparse(node.value).startswith("f'{ROOT}/")
        if is_key and isinstance(node, ast.Assign):
            after = tree.body[i + 1]
            said = isinstance(after, ast.Expr) and isinstance(after.value, ast.Constant)
            assert said, f"{ast.unparse(node.targets[0])}: a string below it says who uses the key"
