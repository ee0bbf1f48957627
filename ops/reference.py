"""Writes docs/messages.md, docs/summary.schema.json and scenarios/scenario.schema.json from the code, as tests hold."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from orograph import keys, layers, messages
from orograph.fields import Array, AtMost, Choice, Flag, Kind, Number, Raw, Text, Whole, kinds_of
from orograph.routes import Route
from orograph.storage.results import Summary
from orograph.storage.scenario_file import scenario_json_schema

ROOT = Path(__file__).parents[1]


def words_of(kind: Kind) -> str:
    """A field's type with its bounds, for people."""
    match kind:
        case Whole() | Number():
            return f"{'int' if isinstance(kind, Whole) else 'float'} {kind.low:g} .. {kind.high:g}"
        case Flag():
            return "bool"
        case Text():
            return f"str <= {kind.high}"
        case Choice():
            return "one of " + ", ".join(f"`{word}`" for word in kind.words)
        case Raw():
            return f"{kind.high} bytes" if kind.low == kind.high else f"{kind.low} .. {kind.high} bytes"
        case Array():
            axes = ", ".join(f"<= {axis.items}" if isinstance(axis, AtMost) else str(axis) for axis in kind.axes)
            names = ", ".join(kind.dtype.names or ())
            return f"array ({axes}) of {f'records {{{names}}}' if names else f'`{kind.dtype.str}`'}"
    raise AssertionError(kind)


def field_row(name: str, kind: Kind) -> str:
    """One table row: name, type with bounds, unit."""
    return f"| `{name}` | {words_of(kind)} | {kind.unit} |"


def layer_row(kind: layers.LayerKind) -> str:
    """One table row: how a register carries a layer, and how it is fused."""
    unknown = "-" if kind.unknown is None else kind.unknown
    return f"| `{kind.name}` | {kind.unit} | {kind.wire.lstrip('<')} | {kind.step:.4g} | {unknown} | {kind.fused} |"


def route_words(route: Route) -> str:
    """`sim`: world to laser, of every robot at once."""
    to, robot = keys.split(route.to)
    return f"`{route.plane}`: {route.sender} to {to}{', of every robot at once' if robot else ''}"


def newest_words(cls: type[messages.Message]) -> str:
    """What a newer message of a kind replaces."""
    per = " and ".join(["sender", *(f"`{field}`" for field in cls.newest_by or ())])
    return f"- in paced time a late receiver takes the newest alone, per {per}"


def reference() -> str:
    """The whole document."""
    lines = [
        "# Messages and keys",
        "",
        f"Written by `ops/reference.py` from `shared/orograph/messages.py` and `keys.py`. Schema version "
        f"{messages.SCHEMA_VERSION}; a fragment on the wire is at most {messages.FRAGMENT_MAX_BYTES} bytes, "
        f"a message at most {messages.MESSAGE_MAX_BYTES}.",
        "",
        "Key of a message: `og/<plane>/<to service>/<to robot | all | ->/<kind>/<from service>/<from robot | ->`, "
        f"planes {' and '.join(f'`{p}`' for p in keys.PLANES)}.",
        f"Control keys on the sim plane: `{keys.TICK}` (the world's clock), `{keys.DONE}/<instance>` (answers), "
        f"`{keys.CLAIM}` (queries for robots), `og/alive/<service>/<instance>/<robots>` (liveliness), "
        f"`{keys.TELEMETRY}/<service>/<robot>` (figures for people).",
    ]
    for name, cls in messages.KINDS.items():
        lines += [
            "",
            f"## {name}",
            "",
            (cls.__doc__ or "").split("\n\n")[0],
            "",
            *(f"- {route_words(route)}" for route in cls.routes),
            *([newest_words(cls)] if cls.newest_by is not None else []),
            "",
            "| field | type | meaning |",
            "|---|---|---|",
        ]
        lines += [field_row(field, kind) for field, kind in kinds_of(cls).items()]
    lines += [
        "",
        "## What a cell holds",
        "",
        "From `shared/orograph/layers.py`; every record of a cell carries these.",
        "",
    ]
    lines += ["| layer | unit | on the wire | one step | unknown | two cells become one |", "|---|---|---|---|---|---|"]
    lines += [layer_row(kind) for kind in layers.MAPPED]
    return "\n".join(lines) + "\n"


def pretty(schema: dict[str, Any]) -> str:
    """A JSON schema as a file for people."""
    return json.dumps(schema, indent=2, ensure_ascii=False) + "\n"


if __name__ == "__main__":
    (ROOT / "docs" / "messages.md").write_text(reference())
    (ROOT / "docs" / "summary.schema.json").write_text(pretty(Summary.model_json_schema()))
    (ROOT / "scenarios" / "scenario.schema.json").write_text(pretty(scenario_json_schema()))
