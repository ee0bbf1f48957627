"""Fields of messages: declared with their kind and bounds, checked the same way at both ends.

A sender that breaks a bound has a fault in its program, a receiver that meets one refuses the message.
`comms/wire.py` turns the plain forms into bytes.
"""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from typing import Any, Final, TypeVar

import numpy as np

from orograph.kinds import HEAD_BYTES, Array, AtMost, Choice, Flag, Kind, Number, Raw, Rejected, Text, Whole, require

T = TypeVar("T")


@dataclass(frozen=True)
class Part:
    """Fields within a field: a message class that travels only as a part of others."""

    cls: type[Any]
    unit: str = ""

    @property
    def bytes_max(self) -> int:
        """Of all its fields."""
        return bytes_max(self.cls)

    def check(self, value: Any) -> None:
        """Each of its fields."""
        require(type(value) is self.cls, "type", type(value))
        for name, kind in kinds_of(self.cls).items():
            kind.check(getattr(value, name))

    def pack(self, value: Any) -> dict[str, Any]:
        """By field name."""
        return pack(value)

    def unpack(self, plain: Any) -> Any:
        """Of the same field names."""
        return unpack(self.cls, plain)

    def schema(self) -> dict[str, Any]:
        """Those of its fields."""
        return {"type": "map", "fields": {name: kind.schema() for name, kind in kinds_of(self.cls).items()}}


def holds(kind: Kind) -> Any:
    """A field of this kind."""
    return dataclasses.field(metadata={"kind": kind})


def integer(low: int, high: int, unit: str = "") -> Any:
    """A whole-number field within [low, high]."""
    return holds(Whole(low, high, unit))


def number(low: float, high: float, unit: str = "") -> Any:
    """A finite float field within [low, high]."""
    return holds(Number(low, high, unit))


def text(max_length: int, doc: str = "", pattern: str = "") -> Any:
    """A short string field."""
    return holds(Text(max_length, doc, pattern))


def choice(words: tuple[str, ...], doc: str = "") -> Any:
    """A field that holds one of these words."""
    return holds(Choice(words, doc))


def flag(doc: str = "") -> Any:
    """A true / false field."""
    return holds(Flag(doc))


def raw(length: int, doc: str = "") -> Any:
    """A field of exactly so many bytes."""
    return holds(Raw(length, length, doc))


def array(dtype: np.dtype[Any] | str, axes: tuple[int | AtMost, ...], unit: str = "") -> Any:
    """An array field."""
    return holds(Array(np.dtype(dtype), axes, unit))


_kinds_of: Final[dict[type[Any], dict[str, Kind]]] = {}
_bytes_max: Final[dict[type[Any], int]] = {}


def kinds_of(cls: type[Any]) -> dict[str, Kind]:
    """A message class's fields by name, in order."""
    if cls not in _kinds_of:
        _kinds_of[cls] = {f.name: f.metadata["kind"] for f in dataclasses.fields(cls)}
    return _kinds_of[cls]


def bytes_max(cls: type[Any]) -> int:
    """The most that a message of this class takes on the wire."""
    if cls not in _bytes_max:
        sizes = (HEAD_BYTES + len(name) + kind.bytes_max for name, kind in kinds_of(cls).items())
        _bytes_max[cls] = 3 * HEAD_BYTES + sum(sizes)
    return _bytes_max[cls]


def pack(message: Any) -> dict[str, Any]:
    """Plain forms by field name; raises Rejected, naming the field, for a value that it may not hold."""
    return {name: _packed(kind, name, getattr(message, name)) for name, kind in kinds_of(type(message)).items()}


def _packed(kind: Kind, name: str, value: Any) -> Any:
    try:
        kind.check(value)
    except Rejected as error:
        raise Rejected(error.reason, f"{name}: {error.detail}") from None
    return kind.pack(value)


def unpack(cls: type[T], plain: Any) -> T:
    """The message that `pack` took apart; raises Rejected, naming the field, for anything else."""
    kinds = kinds_of(cls)
    if type(plain) is not dict or plain.keys() != kinds.keys():
        raise Rejected("keys", cls.__name__)
    return cls(**{name: _unpacked(kind, name, plain[name]) for name, kind in kinds.items()})


def _unpacked(kind: Kind, name: str, plain: Any) -> Any:
    try:
        value = kind.unpack(plain)
        kind.check(value)
    except Rejected as error:
        raise Rejected(error.reason, f"{name}: {error.detail}") from None
    return value


def saturated(cls: type[T], **values: Any) -> T:
    """A message whose numbers end where their fields do, as an instrument's reading does at the end of its scale."""
    kinds = kinds_of(cls)
    return cls(**{name: _clipped(kinds[name], value) for name, value in values.items()})


def _clipped(kind: Kind, value: Any) -> Any:
    return min(max(float(value), kind.low), kind.high) if isinstance(kind, Number) else value
