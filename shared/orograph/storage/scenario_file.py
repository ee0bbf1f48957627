"""Reads scenario files: YAML, with a JSON list of buildings beside, to a checked `Scenario` or to all its problems."""

from __future__ import annotations

import difflib
import json
import math
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, get_args

import yaml
from pydantic import BaseModel, ValidationError
from pydantic_core import ErrorDetails

from orograph.scenario import InconsistentError, Scenario

FILE_NAME = "scenario.yaml"
SCENARIOS = Path("scenarios")
FILE_BYTES_MAX = 20_000_000
DEPTH_MAX = 16
FOUND_CHARS = 60

Loc = tuple[str | int, ...]
WORDING = {
    "string_pattern_mismatch": "text that matches {pattern}",
    "string_type": "text",
    "bool_parsing": "true or false",
    "bool_type": "true or false",
    "float_type": "a number",
    "float_parsing": "a number",
    "int_type": "a whole number",
    "int_parsing": "a whole number",
    "int_from_float": "a whole number",
    "finite_number": "a finite number",
    "greater_than": "more than {gt}",
    "greater_than_equal": "at least {ge}",
    "less_than": "less than {lt}",
    "less_than_equal": "at most {le}",
    "multiple_of": "a multiple of {multiple_of}",
    "literal_error": "{expected}",
    "model_type": "keys and values",
    "tuple_type": "a list",
    "too_short": "at least {min_length} items",
    "too_long": "at most {max_length} items",
}
"""What was expected, by pydantic's type of error; its own words where there is none."""

_Loader: Any = getattr(yaml, "CSafeLoader", yaml.SafeLoader)


class ScenarioError(ValueError):
    """A scenario cannot be used; `problems` holds one line for each reason."""

    def __init__(self, problems: Sequence[str]) -> None:
        super().__init__("\n".join(problems))
        self.problems = tuple(problems)


def load_scenario(name_or_path: str | Path) -> Scenario:
    """The scenario of a folder, a scenario.yaml or a name in ./scenarios; raises ScenarioError with all problems.

    A .json file holds a resolved scenario, as a run folder's parts do.
    """
    path = find_scenario(name_or_path)
    content, lines = _resolved_content(path) if path.suffix == ".json" else _yaml_content(path)
    file_of_buildings = _read_buildings(path, content, lines)
    try:
        return Scenario.model_validate(content)
    except ValidationError as error:
        problems = _problems(error, content)
    problems.sort(key=lambda problem: _line(lines, problem[0]))
    raise ScenarioError([_place(path, lines, loc, file_of_buildings) + text for loc, text in problems])


def find_scenario(name_or_path: str | Path) -> Path:
    """Path of the scenario.yaml meant; raises ScenarioError, naming the nearest known scenario, where there is none."""
    asked = Path(name_or_path)
    for path in (asked, asked / FILE_NAME, SCENARIOS / asked / FILE_NAME):
        if path.is_file():
            return path
    if asked.is_dir():
        raise ScenarioError([f"{asked}: the folder has no {FILE_NAME}"])
    known = sorted(p.parent.name for p in SCENARIOS.glob(f"*/{FILE_NAME}"))
    hint = f"; did you mean {_nearest(str(asked), known)}?" if _nearest(str(asked), known) else ""
    raise ScenarioError([f"{asked}: no such scenario{hint} (known: {', '.join(known) or 'none'})"])


def scenario_json_schema() -> dict[str, Any]:
    """JSON Schema of scenario.yaml for editors; `buildings` may also name a JSON file beside it."""
    schema = Scenario.model_json_schema()
    buildings = schema["properties"]["buildings"]
    in_place = {key: buildings.pop(key) for key in ("items", "type")}
    beside = {"type": "object", "required": ["file"], "additionalProperties": False,
              "properties": {"file": {"type": "string", "description": "a JSON list in this folder"}}}  # fmt: skip
    buildings["anyOf"] = [in_place, beside]
    _drop_infinities(schema)
    return {"$schema": "https://json-schema.org/draft/2020-12/schema", **schema}


def _drop_infinities(schema: Any) -> None:
    """Remove, in place, defaults that JSON cannot write."""
    for inner in schema.values() if isinstance(schema, dict) else schema if isinstance(schema, list) else ():
        if isinstance(inner, dict) and inner.get("default") == math.inf:
            del inner["default"]
        _drop_infinities(inner)


def _yaml_content(path: Path) -> tuple[dict[str, Any], dict[Loc, int]]:
    text = _read_text(path)
    try:
        _refuse_tricks(path, text)
        loader = _Loader(text)
        node = loader.get_single_node()
        content = loader.construct_document(node) if node else None
    except (yaml.YAMLError, ValueError, OverflowError) as error:
        if isinstance(error, ScenarioError):
            raise
        raise ScenarioError([_syntax_problem(path, error)]) from None
    if not isinstance(content, dict):
        raise ScenarioError([f"{path}: expected keys and values (name: ..., title: ...), found {_found(content)}"])
    marked = list(_marks(node, ()))
    seen: dict[Loc, int] = {}
    twice = [f"{path}:{line}: {_dotted(loc)}: given twice, first in line {seen[loc]}"
             for loc, line in marked if seen.setdefault(loc, line) != line]  # fmt: skip
    if twice:
        raise ScenarioError(twice)
    return content, seen


def _resolved_content(path: Path) -> tuple[dict[str, Any], dict[Loc, int]]:
    try:
        content = json.loads(_read_text(path))
    except (RecursionError, ValueError) as error:
        if isinstance(error, ScenarioError):
            raise
        raise ScenarioError([f"{path}: not valid JSON: {error}"]) from None
    if not isinstance(content, dict):
        raise ScenarioError([f"{path}: expected an object, found {_found(content)}"])
    return content, {}


def _read_text(path: Path) -> str:
    try:
        size = path.stat().st_size
        if size > FILE_BYTES_MAX:
            raise ScenarioError([f"{path}: {size} bytes, at most {FILE_BYTES_MAX} are read"])
        return path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise ScenarioError([f"{path}: cannot be read: {getattr(error, 'strerror', None) or error}"]) from None


def _refuse_tricks(path: Path, text: str) -> None:
    """Raise ScenarioError for aliases (they can blow a small file up) and for nesting deeper than any scenario's."""
    depth = 0
    for event in yaml.parse(text, Loader=_Loader):
        depth += isinstance(event, yaml.CollectionStartEvent) - isinstance(event, yaml.CollectionEndEvent)
        trick = "an alias (*name); write the value out" if isinstance(event, yaml.AliasEvent) else ""
        trick = trick or (f"more than {DEPTH_MAX} levels of nesting" if depth > DEPTH_MAX else "")
        if trick:
            raise ScenarioError([f"{path}:{_line_of(event)}: {trick} is not accepted"])


def _line_of(marked: yaml.Event | yaml.Node) -> int:
    assert marked.start_mark is not None
    return marked.start_mark.line + 1


def _syntax_problem(path: Path, error: Exception) -> str:
    mark = getattr(error, "problem_mark", None)
    line = f":{mark.line + 1}" if mark else ""
    column = f" (column {mark.column + 1})" if mark else ""
    return f"{path}{line}: not valid YAML: {getattr(error, 'problem', None) or error}{column}"


def _marks(node: yaml.Node, loc: Loc) -> Iterator[tuple[Loc, int]]:
    """Pairs (location, line) of everything in a document, lines counted from 1."""
    if isinstance(node, yaml.MappingNode):
        for key, value in node.value:
            here = (*loc, str(key.value))
            yield here, _line_of(key)
            yield from _marks(value, here)
    elif isinstance(node, yaml.SequenceNode):
        for index, value in enumerate(node.value):
            yield (*loc, index), _line_of(value)
            yield from _marks(value, (*loc, index))


def _read_buildings(path: Path, content: dict[str, Any], lines: Mapping[Loc, int]) -> Path | None:
    """Put the list that `buildings: {file: ...}` names into `content`; the file's path where there is one."""
    named = content.get("buildings")
    if not (isinstance(named, dict) and list(named) == ["file"] and isinstance(named["file"], str)):
        return None
    beside = path.parent / named["file"]
    place = _place(path, lines, ("buildings", "file"), None)
    if not beside.resolve().is_relative_to(path.parent.resolve()):
        raise ScenarioError([f"{place}expected a file in this folder, found {named['file']!r}"])
    if not beside.is_file():
        raise ScenarioError([f"{place}no such file: {beside}"])
    try:
        content["buildings"] = json.loads(_read_text(beside))
    except json.JSONDecodeError as error:
        raise ScenarioError([f"{beside}:{error.lineno}: not valid JSON: {error.msg} (column {error.colno})"]) from None
    except (RecursionError, ValueError) as error:
        raise ScenarioError([f"{beside}: not valid JSON: {error}"]) from None
    return beside


def _problems(error: ValidationError, content: object) -> list[tuple[Loc, str]]:
    """One (location, text) per location; the branches of a union are told as alternatives."""
    told: dict[Loc, list[str]] = {}
    branches: set[Loc] = set()
    for detail in error.errors():
        if detail["type"] == "too_short" and len(detail["input"]) >= detail["ctx"]["min_length"]:
            continue  # long enough in the file: its wrong items, told apart, are what shortened it
        cause = detail.get("ctx", {}).get("error")
        if isinstance(cause, InconsistentError):
            for loc, text in cause.problems:
                told.setdefault((*detail["loc"], *loc), []).append(text)
            continue
        loc, in_union = _location(detail, content)
        told.setdefault(loc, []).append(_text(detail, loc))
        branches |= {loc} if in_union else set()
    for branch in branches:
        if any(loc[: len(branch)] == branch and loc != branch for loc in told):
            del told[branch]
    return [(loc, _joined(texts)) for loc, texts in told.items()]


def _location(detail: ErrorDetails, content: object) -> tuple[Loc, bool]:
    """Location in the file of pydantic's error: without the names of union branches, and whether there were any."""
    loc: list[str | int] = []
    for step in detail["loc"]:
        inside = (isinstance(content, dict) and step in content) or (
            isinstance(content, list) and isinstance(step, int) and step < len(content)
        )
        if inside:
            content = content[step]  # type: ignore[index]
        if inside or (detail["type"] == "missing" and step == detail["loc"][-1]):
            loc.append(step)
    return tuple(loc), len(loc) < len(detail["loc"])


def _text(detail: ErrorDetails, loc: Loc) -> str:
    if detail["type"] == "missing":
        return "missing"
    if detail["type"] == "extra_forbidden":
        model = _model_at(loc[:-1])
        nearest = _nearest(str(loc[-1]), list(model.model_fields)) if model else None
        return f"unknown key{f'; did you mean {nearest}?' if nearest else ''}"
    if detail["type"] == "value_error":
        return detail["msg"].removeprefix("Value error, ")
    wording = WORDING.get(detail["type"], detail["msg"].replace("{", "{{").replace("}", "}}"))
    return f"expected {wording.format(**detail.get('ctx', {}))}, found {_found(detail['input'])}"


def _joined(texts: list[str]) -> str:
    """`expected a, found x` and `expected b, found x` as `expected a or b, found x`."""
    heads = [text.split(", found ")[0] for text in texts]
    if len(texts) == 1 or len({text.rsplit(", found ", 1)[-1] for text in texts}) > 1:
        return "; ".join(texts)
    rest = texts[0][len(heads[0]) :]
    return " or ".join([heads[0], *(head.removeprefix("expected ") for head in heads[1:])]) + rest


def _model_at(loc: Loc) -> type[BaseModel] | None:
    """The part of the vocabulary that a location holds, None where it holds none."""
    model: type[BaseModel] | None = Scenario
    for step in loc:
        if isinstance(step, str) and model is not None:
            field = model.model_fields.get(step)
            model = next(_parts(field.annotation), None) if field else None
    return model


def _parts(annotation: Any) -> Iterator[type[BaseModel]]:
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        yield annotation
    for argument in get_args(annotation):
        yield from _parts(argument)


def _nearest(word: str, known: Sequence[str]) -> str | None:
    return next(iter(difflib.get_close_matches(word, known, n=1, cutoff=0.5)), None)


def _place(path: Path, lines: Mapping[Loc, int], loc: Loc, file_of_buildings: Path | None) -> str:
    """`file:line: where: ` of a location; the line is that of the nearest enclosing thing written in the file."""
    if file_of_buildings and len(loc) > 1 and loc[0] == "buildings":
        return f"{file_of_buildings}: {_dotted(loc)}: "
    line = _line(lines, loc)
    return f"{path}{f':{line}' if line else ''}: {_dotted(loc)}: "


def _line(lines: Mapping[Loc, int], loc: Loc) -> int:
    return next((lines[loc[:n]] for n in range(len(loc), 0, -1) if loc[:n] in lines), 0)


def _dotted(loc: Loc) -> str:
    return "".join(f"[{step}]" if isinstance(step, int) else f".{step}" for step in loc).removeprefix(".")


def _found(value: object) -> str:
    text = "nothing" if value is None else repr(value)
    return text if len(text) <= FOUND_CHARS else text[: FOUND_CHARS - 3] + "..."
