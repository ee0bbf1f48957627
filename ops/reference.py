"""Writes docs/messages.md from the code: every message with its fields, every key. A test holds the file to it."""

from __future__ import annotations

from dataclasses import Field, fields
from pathlib import Path
from typing import Any

from orograph import keys, messages

TARGET = Path(__file__).parents[1] / "docs" / "messages.md"


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
    TARGET.write_text(reference())
