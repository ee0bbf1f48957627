"""Writes docs/messages.md, messages.json, summary.schema.json and scenarios/scenario.schema.json, as tests hold.

Whoever has the page or the JSON and a Zenoh client can take part in a mission.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
from orograph import keys, layers, messages
from orograph.comms.wire import HEADER
from orograph.control import CONTROLS, Control
from orograph.fields import Part, bytes_max, kinds_of
from orograph.kinds import Array, AtMost, Choice, Each, Flag, Kind, Maybe, Number, Raw, Table, Text, Whole
from orograph.routes import Route, Routed
from orograph.storage.results import Summary
from orograph.storage.scenario_file import scenario_json_schema

ROOT = Path(__file__).parents[1]
RECORDS = {
    name: getattr(messages, name) for name in ("UPDATE", "REGISTER", "CELL", "ACKED", "POSE")
}  # fmt: skip
HEADER_FIELDS = ("frame", "index", "part", "parts", "crc32")
INTRO = f"""# Messages and keys

Written by `ops/reference.py` from `shared/orograph/messages.py`, `control.py` and `keys.py`;
[messages.json](messages.json) says the same for programs. With either and a Zenoh client one can take part in a
mission, in any language.

Two planes, each a Zenoh router of its own, joined as a client: `sim` (the world and its wires, never faulted) and
`radio` (drops what the modelled radio drops). Services: {", ".join(f"`{s}`" for s in keys.SERVICES)}; of those
{", ".join(f"`{s}`" for s in keys.ROBOT_SERVICES)} exist once per robot. Robots are `robot_001` to
`robot_{messages.ROBOTS_MAX:03d}`.

## Bytes

A message is msgpack `[{messages.SCHEMA_VERSION}, {{field: value}}]`: the schema's version, then every field and no
other. A receiver refuses, and counts by reason, what breaks a bound below, is longer than its kind can be, or came
along no route of its kind.

- int, float, bool, str, bytes: msgpack's own (a float may be written as a whole number); floats are finite, text is
  printable.
- array: `[[n, ...], bytes]`, shape and content, row after row, little-endian, no padding; records as listed below.
- list, map: msgpack's own; `nil` only where a value may be none.

**Messages of nodes** go by `og/<plane>/<to service>/<to robot>/<kind>/<from service>/<from robot>`: `all` for every
robot at once, `-` where there is no robot. A node subscribes to `og/<plane>/<service>/<robot or ->/**` and, if of a
robot, to `og/<plane>/<service>/all/**`. Each message is cut into fragments of at most {messages.FRAGMENT_MAX_BYTES}
bytes, each a put of its own behind a header of {HEADER.size} bytes, little-endian: `frame` u4, `index` u4 (0, 1, ...
among all that this node sends in this frame), `part` u2, `parts` u2, `crc32` u4 of the whole message (zlib's).

**Control messages** have keys of their own, are not cut and have no header.

**Streams**: in ticks and answers a message is counted under its key without root and kind:
`radio/map-manager/-/robot-mapping/robot_001`.

**Liveliness** (sim plane): the token `og/alive/<service>/<instance>/<robots joined by + or ->` says that an instance
lives and what it holds. `instance` is any name of letters, digits, `_` and `-` that nobody else has.

## How to join

As the mapping of a robot; laser and navigator join the same way.

1. Open a client session on each plane's router. Query `{keys.BRIEFING}` (no payload) until a CurrentRun comes:
   `scenario` is zlib over JSON as in [scenario.schema.json](../scenarios/scenario.schema.json).
2. Query `{keys.CLAIM}` with a Claim until a Grant names robots; one without says why: wait and ask again. Declare the
   liveliness token within 5 s, or the grant ends; with it the robots are yours until the token goes.
3. Subscribe to the node's keys on both planes and to `{keys.TICK}`, then put Answers of frame -1, three a second, on
   `{keys.DONE}/<instance>` until a tick's `roster` names the instance. A robot is there once all three of its
   services are.
4. At every newer Tick that names you: if `lockstep`, wait until what `counted` says was sent to your addresses in
   frame - 1 is there, except at your first. Drop what came by radio from or to a robot that is in `down`, and what the
   scenario's `radio.loss` loses (`shared/orograph/radio.py` says which). Step with what was sent in frames before this
   one, ordered by frame, sender (`service/robot`) and index. Send under this `frame`, then put the Answer with what was
   sent, by stream. The same tick again: the same answer again.
5. A mapper says Hello (16 random bytes) and repeats it until Welcome has come in all parts, sends Batch of that epoch
   until each record is acknowledged by an Ack of the same cell and seq, and keeps its copy of the map by Delta and
   Digest ([protocol.md](protocol.md)). Every second it sends MappingStatus. Phase `flush` asks for what is left.
6. At a Tick with `end`, a Release, or SIGTERM: undeclare the token and go.
"""


def words_of(kind: Kind) -> str:
    """A field's type with its bounds, for people."""
    match kind:
        case Whole() | Number():
            return f"{'int' if isinstance(kind, Whole) else 'float'} {_figure(kind.low)} .. {_figure(kind.high)}"
        case Flag():
            return "bool"
        case Text():
            return f"str <= {kind.high}" + (f" `{kind.pattern}`".replace("|", "\\|") if kind.pattern else "")
        case Choice():
            return "one of " + ", ".join(f"`{word}`" if word else "empty" for word in kind.words)
        case Raw():
            return f"{kind.high} bytes" if kind.low == kind.high else f"{kind.low} .. {kind.high} bytes"
        case Array():
            axes = ", ".join(f"<= {axis.items}" if isinstance(axis, AtMost) else str(axis) for axis in kind.axes)
            return f"array ({axes}) of {_item(kind.dtype)}"
        case Each():
            return f"list of <= {kind.high}: {words_of(kind.of)}"
        case Table():
            return f"map of <= {kind.high}: {words_of(kind.key)} to {words_of(kind.of)}"
        case Maybe():
            return f"{words_of(kind.of)}, or none"
        case Part():
            return "map of " + ", ".join(f"`{name}` {words_of(of)}" for name, of in kinds_of(kind.cls).items())
    raise AssertionError(kind)


def _figure(value: float) -> str:
    """Powers of two as such, for they are no round numbers."""
    for exponent in (32, 62):
        if value in (2**exponent, 2**exponent - 1):
            return f"2^{exponent}" + ("" if value == 2**exponent else " - 1")
    return f"{value:g}"


def _item(dtype: np.dtype[Any]) -> str:
    return next((name for name, record in RECORDS.items() if record == dtype), dtype.str.lstrip("<|"))


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


def newest_words(cls: type[Routed]) -> str:
    """What a newer message of a kind replaces."""
    per = " and ".join(["sender", *(f"`{field}`" for field in cls.newest_by or ())])
    return f"- in paced time a late receiver takes the newest alone, per {per}"


def section(cls: type[Routed]) -> list[str]:
    """One kind of message: what it is, its routes, its fields."""
    manner = {"put": "put on", "query": "query of", "reply": "answer to a query of"}
    lines = ["", f"### {cls.__name__}", "", " ".join((cls.__doc__ or "").split("\n\n")[0].split()), ""]
    if issubclass(cls, Control):
        lines += [f"- {manner[cls.manner]} `{cls.key}`"]
    lines += [f"- {route_words(route)}" for route in cls.routes]
    lines += [newest_words(cls)] if cls.newest_by is not None else []
    lines += [f"- at most {bytes_max(cls)} bytes"]
    rows = [field_row(field, kind) for field, kind in kinds_of(cls).items()]
    return [*lines, *(["", "| field | type | meaning |", "|---|---|---|", *rows] if rows else [])]


def record_rows() -> list[str]:
    """The layouts of records, field by field with its offset."""
    rows = ["| record | bytes | fields: offset type name |", "|---|---|---|"]
    for name, record in RECORDS.items():
        parts = [f"{record.fields[f][1]} {_typed(record.fields[f][0])} {f}" for f in record.names]
        rows.append(f"| {name} | {record.itemsize} | {', '.join(parts)} |")
    return rows


def _typed(dtype: np.dtype[Any]) -> str:
    return dtype.base.str.lstrip("<|") + ("x" + "x".join(map(str, dtype.shape)) if dtype.shape else "")


def reference() -> str:
    """The whole document."""
    lines = [*INTRO.rstrip().split("\n"), "", "## Messages of nodes"]
    for kind in messages.KINDS.values():
        lines += section(kind)
    lines += ["", "## Control messages"]
    for control in CONTROLS.values():
        lines += section(control)
    lines += ["", "## Records", "", *record_rows(), "", "## What a cell holds", ""]
    lines += ["From `shared/orograph/layers.py`; every record of a cell carries these.", ""]
    lines += ["| layer | unit | on the wire | one step | unknown | two cells become one |", "|---|---|---|---|---|---|"]
    lines += [layer_row(kind) for kind in layers.MAPPED]
    return "\n".join(lines) + "\n"


def contract(cls: type[Routed]) -> dict[str, Any]:
    """One kind of message as data."""
    routes = [{"plane": r.plane, "from": r.sender, "to": keys.split(r.to)[0], "all": "/" in r.to} for r in cls.routes]
    fields = {name: {**kind.schema(), "meaning": kind.unit} for name, kind in kinds_of(cls).items()}
    doc = " ".join((cls.__doc__ or "").split())
    told = {"doc": doc, "routes": routes, "newest_by": cls.newest_by, "bytes_max": bytes_max(cls), "fields": fields}
    return {**told, "key": cls.key, "manner": cls.manner} if issubclass(cls, Control) else told


def contracts() -> str:
    """All of it for programs."""
    told = {
        "schema_version": messages.SCHEMA_VERSION,
        "fragment": {"max_bytes": messages.FRAGMENT_MAX_BYTES, "header": HEADER.format, "fields": HEADER_FIELDS},
        "message_key": "og/{plane}/{to}/{to_robot}/{kind}/{from}/{from_robot}",
        "alive_key": "og/alive/{service}/{instance}/{robots}",
        "stream": "{plane}/{to}/{to_robot}/{from}/{from_robot}",
        "every_robot": keys.ALL, "no_robot": keys.NONE,
        "robot_services": keys.ROBOT_SERVICES,
        "messages": {name: contract(cls) for name, cls in messages.KINDS.items()},
        "controls": {name: contract(cls) for name, cls in CONTROLS.items()},
    }  # fmt: skip
    return json.dumps(told, indent=1, ensure_ascii=False) + "\n"


def pretty(schema: dict[str, Any]) -> str:
    """A JSON schema as a file for people."""
    return json.dumps(schema, indent=2, ensure_ascii=False) + "\n"


if __name__ == "__main__":
    (ROOT / "docs" / "messages.md").write_text(reference())
    (ROOT / "docs" / "messages.json").write_text(contracts())
    (ROOT / "docs" / "summary.schema.json").write_text(pretty(Summary.model_json_schema()))
    (ROOT / "scenarios" / "scenario.schema.json").write_text(pretty(scenario_json_schema()))
