"""Writes docs/messages.md and scenarios/scenario.schema.json from the code. Tests hold the files to it."""

from __future__ import annotations

import json
from dataclasses import Field, fields
from pathlib import Path
from typing import Any

from orograph import keys, messages
from orograph.storage.scenario_file import scenario_json_schema

ROOT = Path(__file__).parents[1]


def field_row(spec: Field[Any]) -> str:
    """One table row: name, type with bounds, unit."""
    meta = spec.metadata
    match meta["kind"]:
        case "array":
            shape = ", ".join("n" if n is None else str(n) for n in meta["shape"])
            names = ", ".join(meta["dtype"].names or ())
            kind = (
                f"array ({shape}) of {f'records {{{names}}}' if names else meta['dtype'].str}, <= {meta['high']} items"
            )
        case "int" | "float":
            kind = f"{meta['kind']} {meta['low']:g} .. {meta['high']:g}"
        case "bool":
            kind = "bool"
        case other:
            kind = f"{other} <= {meta['high']}"
    return f"| `{spec.name}` | {kind} | {meta['unit']} |"


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
            "| field | type | meaning |",
            "|---|---|---|",
        ]
        lines += [field_row(spec) for spec in fields(cls)]
    return "\n".join(lines) + "\n"


if __name__ == "__main__":
    (ROOT / "docs" / "messages.md").write_text(reference())
    schema = json.dumps(scenario_json_schema(), indent=2, ensure_ascii=False) + "\n"
    (ROOT / "scenarios" / "scenario.schema.json").write_text(schema)
