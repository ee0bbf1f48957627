"""Kinds of message fields: what a value may be, its plain form on the wire, the most bytes it takes there.

Each kind has one check, and both ends use it: a sender that breaks a bound has a fault in its program, a receiver
that meets one refuses the message. `comms/wire.py` turns the plain forms into bytes.
"""

from __future__ import annotations

import dataclasses
import math
import re
from dataclasses import dataclass
from typing import Any, Final, Protocol, TypeVar

import numpy as np

HEAD_BYTES: Final = 9
"""The most that msgpack puts before a value or takes for a number."""

T = TypeVar("T")


class Rejected(ValueError):  # noqa: N818 - the word the protocol uses
    """A value or payload that must not be believed; `reason` is a short word to count by."""

    def __init__(self, reason: str, detail: str = "") -> None:
        super().__init__(f"{reason}: {detail}" if detail else reason)
        self.reason, self.detail = reason, detail


class Kind(Protocol):
    """What one field may hold."""

    @property
    def unit(self) -> str:
        """Unit or meaning, for people."""

    @property
    def bytes_max(self) -> int:
        """The most that a value takes on the wire."""

    def check(self, value: Any) -> None:
        """Raise Rejected with the reason `type`, `range` or `shape` for what the field may not hold."""

    def pack(self, value: Any) -> Any:
        """The plain form of a checked value."""

    def unpack(self, plain: Any) -> Any:
        """The value of a plain form, not checked yet; raises Rejected where there can be none."""

    def schema(self) -> dict[str, Any]:
        """Type and bounds as data, for the reference."""


def _require(holds: bool | np.bool_, reason: str, value: Any) -> None:
    if not holds:
        raise Rejected(reason, repr(value)[:60])


@dataclass(frozen=True)
class Whole:
    """A whole number within [low, high]."""

    low: int
    high: int
    unit: str = ""
    bytes_max: int = HEAD_BYTES

    def check(self, value: Any) -> None:
        """Booleans are no numbers."""
        _require(isinstance(value, (int, np.integer)) and not isinstance(value, bool), "type", value)
        _require(self.low <= value <= self.high, "range", value)

    def pack(self, value: Any) -> int:
        """A Python int."""
        return int(value)

    def unpack(self, plain: Any) -> Any:
        """As it is."""
        return plain

    def schema(self) -> dict[str, Any]:
        """Bounds, both included."""
        return {"type": "int", "min": self.low, "max": self.high}


@dataclass(frozen=True)
class Number:
    """A finite number within [low, high]; some languages write 1.0 as 1, so a whole number is one too."""

    low: float
    high: float
    unit: str = ""
    bytes_max: int = HEAD_BYTES

    def check(self, value: Any) -> None:
        """NaN is within no bounds."""
        known = isinstance(value, (float, int, np.floating, np.integer)) and not isinstance(value, bool)
        _require(known, "type", value)
        _require(self.low <= value <= self.high and math.isfinite(value), "range", value)

    def pack(self, value: Any) -> float:
        """A Python float."""
        return float(value)

    def unpack(self, plain: Any) -> Any:
        """A whole number of a size that a float can hold becomes a float."""
        return float(plain) if type(plain) is int and abs(plain) < 2**63 else plain

    def schema(self) -> dict[str, Any]:
        """Bounds, both included."""
        return {"type": "float", "min": self.low, "max": self.high}


@dataclass(frozen=True)
class Flag:
    """True or false."""

    unit: str = ""
    bytes_max: int = 1

    def check(self, value: Any) -> None:
        """Nothing else will do, 0 and 1 included."""
        _require(isinstance(value, (bool, np.bool_)), "type", value)

    def pack(self, value: Any) -> bool:
        """A Python bool."""
        return bool(value)

    def unpack(self, plain: Any) -> Any:
        """As it is."""
        return plain

    def schema(self) -> dict[str, Any]:
        """No bounds."""
        return {"type": "bool"}


@dataclass(frozen=True)
class Text:
    """Printable text of at most `high` characters; all of it matches `pattern` if there is one."""

    high: int
    unit: str = ""
    pattern: str = ""

    @property
    def bytes_max(self) -> int:
        """UTF-8 takes four bytes for a character at most."""
        return HEAD_BYTES + 4 * self.high

    def check(self, value: Any) -> None:
        """What cannot be printed can hide something in a log, and half a surrogate cannot be written at all."""
        _require(type(value) is str, "type", value)
        _require(len(value) <= self.high and value.isprintable(), "range", value)
        _require(not self.pattern or bool(re.fullmatch(self.pattern, value)), "range", value)

    def pack(self, value: Any) -> str:
        """As it is."""
        return str(value)

    def unpack(self, plain: Any) -> Any:
        """As it is."""
        return plain

    def schema(self) -> dict[str, Any]:
        """The greatest length in characters, and the pattern where there is one."""
        return {"type": "str", "max": self.high, **({"pattern": self.pattern} if self.pattern else {})}


@dataclass(frozen=True)
class Choice:
    """One of a few words."""

    words: tuple[str, ...]
    unit: str = ""

    @property
    def bytes_max(self) -> int:
        """The longest word's."""
        return HEAD_BYTES + max(map(len, self.words))

    def check(self, value: Any) -> None:
        """No other word is known."""
        _require(type(value) is str, "type", value)
        _require(value in self.words, "range", value)

    def pack(self, value: Any) -> str:
        """As it is."""
        return str(value)

    def unpack(self, plain: Any) -> Any:
        """As it is."""
        return plain

    def schema(self) -> dict[str, Any]:
        """The words."""
        return {"type": "str", "one_of": list(self.words)}


@dataclass(frozen=True)
class Raw:
    """Bytes, from `low` to `high` of them."""

    low: int
    high: int
    unit: str = ""

    @property
    def bytes_max(self) -> int:
        """They travel as they are."""
        return HEAD_BYTES + self.high

    def check(self, value: Any) -> None:
        """Bytes and nothing that merely holds some."""
        _require(type(value) is bytes, "type", value)
        _require(self.low <= len(value) <= self.high, "range", len(value))

    def pack(self, value: Any) -> bytes:
        """As it is."""
        return bytes(value)

    def unpack(self, plain: Any) -> Any:
        """As it is."""
        return plain

    def schema(self) -> dict[str, Any]:
        """Length in bytes, both bounds included."""
        return {"type": "bytes", "min": self.low, "max": self.high}


@dataclass(frozen=True)
class AtMost:
    """The length of an array along one axis: any up to this."""

    items: int


@dataclass(frozen=True)
class Array:
    """A little-endian array, rows first; along each axis as many items as said, or up to as many; floats are finite."""

    dtype: np.dtype[Any]
    axes: tuple[int | AtMost, ...]
    unit: str = ""

    @property
    def items_max(self) -> int:
        """The greatest number of items."""
        return math.prod(axis.items if isinstance(axis, AtMost) else axis for axis in self.axes)

    @property
    def bytes_max(self) -> int:
        """Shape and content."""
        return HEAD_BYTES * (3 + len(self.axes)) + self.items_max * self.dtype.itemsize

    def check(self, value: Any) -> None:
        """A type of the same width is another type."""
        _require(isinstance(value, np.ndarray) and value.dtype == self.dtype, "type", getattr(value, "dtype", value))
        _require(self._fits(value.shape), "shape", value.shape)
        _require(_finite(value), "range", "not finite")

    def _fits(self, shape: tuple[int, ...]) -> bool:
        return len(shape) == len(self.axes) and all(
            n <= axis.items if isinstance(axis, AtMost) else n == axis for n, axis in zip(shape, self.axes, strict=True)
        )

    def pack(self, value: Any) -> list[Any]:
        """[shape, content]."""
        return [list(value.shape), value.tobytes()]

    def unpack(self, plain: Any) -> np.ndarray[Any, Any]:
        """Nothing is allocated beyond what came; writable, as Numba compiles a kernel anew for what is read-only."""
        _require(type(plain) is list and len(plain) == 2, "type", type(plain))
        shape, content = plain
        _require(type(shape) is list and type(content) is bytes, "type", type(content))
        _require(all(type(n) is int and n >= 0 for n in shape) and self._fits(tuple(shape)), "shape", shape)
        _require(math.prod(shape) * self.dtype.itemsize == len(content), "shape", len(content))
        return np.frombuffer(bytearray(content), self.dtype).reshape(shape)

    def schema(self) -> dict[str, Any]:
        """NumPy's name of the type, or name, type and shape of each of a record's fields; the axes."""
        axes = [{"max": axis.items} if isinstance(axis, AtMost) else axis for axis in self.axes]
        return {"type": "array", "dtype": _layout(self.dtype), "item_bytes": self.dtype.itemsize, "axes": axes}


def _layout(dtype: np.dtype[Any]) -> Any:
    if dtype.names is None:
        return dtype.str
    return [[name, dtype[name].base.str, list(dtype[name].shape)] for name in dtype.names]


def _finite(values: np.ndarray[Any, Any]) -> bool:
    if values.dtype.names:
        return all(_finite(values[name]) for name in values.dtype.names)
    return values.dtype.kind != "f" or bool(np.isfinite(values).all())


def _field(kind: Kind) -> Any:
    return dataclasses.field(metadata={"kind": kind})


def integer(low: int, high: int, unit: str = "") -> Any:
    """A whole-number field within [low, high]."""
    return _field(Whole(low, high, unit))


def number(low: float, high: float, unit: str = "") -> Any:
    """A finite float field within [low, high]."""
    return _field(Number(low, high, unit))


def text(max_length: int, doc: str = "", pattern: str = "") -> Any:
    """A short string field."""
    return _field(Text(max_length, doc, pattern))


def choice(words: tuple[str, ...], doc: str = "") -> Any:
    """A field that holds one of these words."""
    return _field(Choice(words, doc))


def flag(doc: str = "") -> Any:
    """A true / false field."""
    return _field(Flag(doc))


def raw(length: int, doc: str = "") -> Any:
    """A field of exactly so many bytes."""
    return _field(Raw(length, length, doc))


def array(dtype: np.dtype[Any] | str, axes: tuple[int | AtMost, ...], unit: str = "") -> Any:
    """An array field."""
    return _field(Array(np.dtype(dtype), axes, unit))


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
